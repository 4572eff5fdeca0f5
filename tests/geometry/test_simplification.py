"""Simplified meshes are near the original ones, and say how near."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.geometry import simplification
from gpis_grasp_planner.geometry.catalogue import load_part
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.mass_properties import signed_volume
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.simplification import simplify
from gpis_grasp_planner.geometry.topology import find_edges


def bumpy_torus(nu: int, nv: int) -> TriangleMesh:
    """A torus of 110 mm with bumps of 1.5 mm, 2 nu nv triangles."""
    u = np.linspace(0, 2 * np.pi, nu, endpoint=False)[:, None]
    v = np.linspace(0, 2 * np.pi, nv, endpoint=False)[None]
    r = 0.012 + 0.0015 * np.sin(7 * u) * np.cos(3 * v)
    ring = 0.04 + r * np.cos(v)
    vertices = np.stack([ring * np.cos(u), ring * np.sin(u), r * np.sin(v) + 0 * u], axis=-1)
    a = np.arange(nu * nv).reshape(nu, nv)
    b, d = np.roll(a, -1, axis=0), np.roll(a, -1, axis=1)
    c = np.roll(b, -1, axis=1)
    faces = np.concatenate([np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])
    return TriangleMesh(vertices.reshape(-1, 3), faces.astype(np.int32))


def test_a_large_mesh_keeps_its_shape(rng):
    mesh = bumpy_torus(500, 200)
    found = simplify(mesh)
    assert found is not None
    assert len(found.mesh.faces) <= 1.01 * simplification.TARGETS[0]
    edges = find_edges(found.mesh.faces)
    assert edges.closed
    assert edges.agree.all()
    assert signed_volume(found.mesh.triangles) == pytest.approx(
        signed_volume(mesh.triangles), rel=2e-3
    )
    assert found.deviation <= simplification.TOLERANCE * mesh.extent.max()
    # Other points and another library find hardly more than what is stated.
    points, _ = trimesh.sample.sample_surface(
        trimesh.Trimesh(found.mesh.vertices, found.mesh.faces), 300, seed=int(rng.integers(1000))
    )
    original = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    for p in points[:60]:
        near = np.argsort(np.linalg.norm(original.triangles_center - p, axis=1))[:60]
        # In millimetres: trimesh takes triangles of a tenth of a millimetre in metres for lines.
        p_mm, triangles_mm = 1e3 * p, 1e3 * mesh.triangles[near]
        nearest = trimesh.triangles.closest_point(triangles_mm, np.tile(p_mm, (60, 1)))
        assert np.linalg.norm(nearest - p_mm, axis=1).min() <= 1.5e3 * found.deviation


def test_small_meshes_are_left_alone():
    assert simplify(bumpy_torus(100, 50)) is None


def test_flat_places_go_first():
    box = trimesh.creation.box((0.1, 0.06, 0.04))
    for _ in range(7):
        box = box.subdivide()
    mesh = TriangleMesh(np.asarray(box.vertices), np.asarray(box.faces, dtype=np.int32))
    found = simplify(mesh)
    assert found is not None
    assert found.deviation < 1e-6
    assert signed_volume(found.mesh.triangles) == pytest.approx(0.1 * 0.06 * 0.04, rel=1e-5)


def test_a_large_part_is_kept_whole_beside_its_simplified_mesh(write, mesh_path, monkeypatch):
    monkeypatch.setattr(simplification, "TARGETS", (2_000,))
    mesh = bumpy_torus(120, 50)
    path = mesh_path(write.binary_stl(mesh.vertices, mesh.faces))
    part = load_part(path, "m", CatalogueSettings(simplify_above_faces=10_000))
    assert len(part.mesh.faces) == 12_000
    assert part.simplified is not None
    assert part.working_mesh is part.simplified
    assert len(part.simplified.faces) <= 2_020
    assert any("were simplified to" in note for note in part.notes)
    same = load_part(path, "m", CatalogueSettings(simplify_above_faces=12_000))
    assert same.simplified is None
    assert same.working_mesh is same.mesh
    assert same.mesh.content_hash == part.mesh.content_hash
