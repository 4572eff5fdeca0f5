"""A cloud's closed surface: known balls and boxes, what was not seen, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from cloud_shapes import CENTER, RADIUS, box_points, sphere_points

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.cloud.reconstruct import reconstruct
from gpis_grasp_planner.geometry.formats.parsed_cloud import ParsedCloud
from gpis_grasp_planner.geometry.topology import find_edges

SETTINGS = CatalogueSettings(cloud_samples=300, cloud_cells=40)
EYE = CENTER + np.array([0.0, 0.0, 0.5])


def made(points, settings=SETTINGS, **more):
    return reconstruct(ParsedCloud(points, **more), name="cloud", unit="m", settings=settings)


def radii(vertices):
    return np.linalg.norm(vertices - CENTER, axis=1)


def test_a_noisy_ball_is_the_ball(rng):
    found = made(sphere_points(rng, 3000, 0.001)[0])
    mesh = found.judged.mesh
    assert found.judged.watertight
    assert find_edges(mesh.faces).closed
    assert np.abs(radii(mesh.vertices) - RADIUS).mean() < 0.0004
    assert found.judged.volume == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=0.03)
    # The deviation is that of means of some ten points with 1 mm each.
    assert 0.0001 < np.median(found.uncertainty.deviation) < 0.001
    assert "noise 1 mm estimated" in found.notes[0] or "noise 0.9" in found.notes[0]


def test_of_a_half_seen_ball_the_back_is_closed_and_less_certain(rng):
    points, _ = sphere_points(rng, 3000, 0.001, cap=0.1)
    found = made(points, viewpoints=EYE[None])
    assert found.judged.watertight
    at, deviation = found.uncertainty.points, found.uncertainty.deviation
    z = (at - CENTER)[:, 2] / RADIUS
    assert np.median(deviation[z < -0.6]) > 4.0 * np.median(deviation[z > 0.3])
    np.testing.assert_allclose(found.uncertainty.deviation_at(at[:50]), deviation[:50])
    vertices = found.judged.mesh.vertices
    z = (vertices - CENTER)[:, 2] / RADIUS
    assert np.abs(radii(vertices) - RADIUS)[z > 0.3].mean() < 0.0005
    assert np.abs(radii(vertices) - RADIUS)[z < -0.3].mean() < 0.2 * RADIUS


def test_draws_scatter_where_nobody_looked_and_agree_where_somebody_did(rng):
    points, _ = sphere_points(rng, 3000, 0.001, cap=0.1)
    found = made(points, viewpoints=EYE[None])
    draws = found.uncertainty.draws
    assert len(draws) == SETTINGS.cloud_draws
    front, back = [], []
    for mesh in draws:
        assert find_edges(mesh.faces).closed
        way = mesh.vertices - CENTER
        z = way[:, 2] / np.linalg.norm(way, axis=1)
        front.append(radii(mesh.vertices)[z > 0.8].mean())
        back.append(radii(mesh.vertices)[z < -0.8].mean())
    assert np.std(back) > 3.0 * np.std(front)


def test_a_set_noise_counts_and_more_noise_is_less_certain(rng):
    points, _ = box_points(rng)
    few, many = (
        made(points, CatalogueSettings(cloud_samples=200, cloud_cells=32, cloud_noise_m=noise))
        for noise in (0.0002, 0.007)
    )
    assert "7 mm as set" in many.notes[0]
    ratio = np.median(many.uncertainty.deviation) / np.median(few.uncertainty.deviation)
    assert ratio > 1.3


def test_the_same_cloud_gives_the_same_mesh(rng):
    points, _ = box_points(rng, noise=0.0005)
    one, two = made(points), made(points)
    assert one.judged.mesh.content_hash == two.judged.mesh.content_hash
    for a, b in zip(one.uncertainty.draws, two.uncertainty.draws, strict=True):
        assert a.content_hash == b.content_hash


def test_a_turned_cloud_gives_a_turned_surface(rng):
    """Nothing depends on the frame but the grid: volumes agree within its resolution."""
    points, normals = box_points(rng, noise=0.0005)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    plain = made(points, normals=normals).judged.volume
    turned = made(points @ q.T, normals=normals @ q.T).judged.volume
    assert turned == pytest.approx(plain, rel=0.03)
    assert plain == pytest.approx(0.06 * 0.05 * 0.04, rel=0.06)


def test_a_sheet_is_refused_with_its_thickness(rng):
    points = np.concatenate([rng.uniform(-0.05, 0.05, (2000, 2)), np.zeros((2000, 1))], axis=1)
    points += 0.0005 * rng.normal(size=points.shape)
    with pytest.raises(MeshError, match=r"is a flat sheet: .* second side") as caught:
        made(points)
    assert caught.value.code == ErrorCode.MESH_DEGENERATE


def test_a_cloud_of_millimetres_is_told_the_unit(rng):
    with pytest.raises(MeshError, match="probably in millimetres") as caught:
        made(1000.0 * sphere_points(rng, 1000)[0])
    assert caught.value.code == ErrorCode.MESH_EXTENT_IMPLAUSIBLE
