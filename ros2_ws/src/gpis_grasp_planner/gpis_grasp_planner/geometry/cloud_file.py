"""Point clouds in place of mesh files: which files hold one, and the part's surface made of it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.formats.parsed_cloud import CLOUD_SUFFIXES, ParsedCloud
from gpis_grasp_planner.geometry.formats.pcd import read_pcd
from gpis_grasp_planner.geometry.formats.ply import has_faces, read_ply_points
from gpis_grasp_planner.geometry.formats.xyz import read_xyz
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.mesh_file import MeshReport
from gpis_grasp_planner.geometry.uncertainty import SurfaceUncertainty
from gpis_grasp_planner.geometry.units import metres_per

READERS: dict[str, Callable[[bytes, str, int], ParsedCloud]] = {
    ".ply": read_ply_points,
    ".pcd": read_pcd,
    ".xyz": read_xyz,
}


def is_cloud(data: bytes, suffix: str, name: str) -> bool:
    """Whether a file holds points and no faces.

    Raises
    ------
    MeshError
        Where a PLY file's header cannot be read.
    """
    return suffix in CLOUD_SUFFIXES or (suffix == ".ply" and not has_faces(data, name))


def parse_cloud(
    data: bytes,
    suffix: str,
    unit: str,
    name: str,
    settings: CatalogueSettings,
    *,
    scale: float = 1.0,
    viewpoints_m: NDArray[np.float64] | None = None,
) -> tuple[TriangleMesh, MeshReport, SurfaceUncertainty]:
    """Read the bytes of a cloud and close its surface; see `cloud.reconstruct`.

    Parameters
    ----------
    data, suffix, unit, name, settings, scale
        As for `mesh_file.parse_mesh`.
    viewpoints_m : (k, 3) array [m], optional
        Where the sensor stood, in the file's frame; the file's own if not given.

    Raises
    ------
    MeshError
        With the code of the defect.
    """
    from gpis_grasp_planner.geometry.cloud.reconstruct import reconstruct  # SciPy

    metres = scale * metres_per(unit, name)
    parsed = READERS[suffix](data, name, settings.max_faces)
    cloud = replace(
        parsed,
        points=parsed.points * metres,
        viewpoints=parsed.viewpoints * metres if viewpoints_m is None else viewpoints_m,
    )
    made = reconstruct(cloud, name=name, unit=unit, settings=settings)
    judged = made.judged
    report = MeshReport(
        file_format=suffix[1:],
        unit=unit,
        file_sha256=hashlib.sha256(data).hexdigest(),
        watertight=judged.watertight,
        volume=judged.volume,
        center_of_volume=judged.center_of_volume,
        bodies=judged.bodies,
        notes=(*made.notes, *parsed.notes, *judged.notes),
    )
    return judged.mesh, report, made.uncertainty
