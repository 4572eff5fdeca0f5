"""GLB: coordinates that are not finite go to the judge of meshes without a warning of NumPy."""

from __future__ import annotations

import mesh_dialects as d
import numpy as np

from gpis_grasp_planner.geometry.formats.glb import read_glb


def test_infinite_coordinates_are_read_without_a_warning():
    vertices = d.BOX.vertices.copy()
    vertices[0] = (np.inf, 0.0, 0.0)
    document, binary = d.glb_document(d.Solid(vertices, d.BOX.polygons, d.BOX.volume))
    assert not np.isfinite(read_glb(d.glb(document, binary), "box.glb", 1000).vertices).all()
