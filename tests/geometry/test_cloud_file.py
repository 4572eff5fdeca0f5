"""Files of points: what each format holds, what a part of one is, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from cloud_shapes import CENTER, RADIUS, pcd, ply, sphere_points, xyz

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, load_part
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.cloud_file import READERS
from gpis_grasp_planner.geometry.mesh_file import load_mesh

SMALL = CatalogueSettings(cloud_samples=150, cloud_cells=24, cloud_draws=2)
EYE = CENTER + np.array([0.0, 0.0, 0.4])


def read(data, suffix):
    return READERS[suffix](data, f"part{suffix}", 1_000_000)


@pytest.fixture
def cloud(rng):
    return sphere_points(rng, 500, 0.0005)


@pytest.mark.parametrize(
    ("suffix", "write"),
    [
        (".xyz", xyz),
        (".xyz", lambda p: b"# made by a test\r\n" + xyz(p).replace(b"\n", b"\r\n")),
        (".pcd", pcd),
        (".pcd", lambda p: pcd(p, "ascii")),
        (".ply", ply),
    ],
)
def test_every_format_gives_the_points(cloud, suffix, write):
    found = read(write(cloud[0]), suffix)
    np.testing.assert_allclose(found.points, cloud[0], atol=1e-7)
    assert len(found.viewpoints) == 0


def test_normals_and_the_place_of_the_sensor_are_read(cloud):
    points, normals = cloud
    found = read(ply(points, normals, EYE), ".ply")
    np.testing.assert_allclose(found.normals, normals, atol=1e-6)
    np.testing.assert_allclose(found.viewpoints, [EYE], atol=1e-6)
    np.testing.assert_allclose(read(pcd(points, viewpoint=EYE), ".pcd").viewpoints, [EYE])
    six = np.concatenate([points, normals], axis=1)
    np.testing.assert_allclose(read(xyz(six), ".xyz").normals, normals, atol=1e-6)


def test_six_columns_that_are_no_normals_are_passed_over_with_a_note(cloud, rng):
    colours = rng.integers(0, 255, (500, 3))
    found = read(xyz(np.concatenate([cloud[0], colours], axis=1)), ".xyz")
    assert found.normals is None
    assert "3 columns" in found.notes[0]


def test_rows_without_a_return_of_an_organised_cloud_are_left_out_and_noted(cloud):
    points = cloud[0].copy()
    points[7:20] = np.nan
    found = read(pcd(points), ".pcd")
    assert len(found.points) == 487
    assert "13 of 500 rows" in found.notes[0]


@pytest.mark.parametrize(
    ("suffix", "data", "words", "code"),
    [
        (".xyz", b"0 0 0\n1 nan 0\n", "not finite", ErrorCode.MESH_NOT_FINITE),
        (".xyz", b"0 0 0\n1 0\n", "line 2 has 2 numbers", ErrorCode.MESH_UNREADABLE),
        (".xyz", b"1 2\n", "a point takes 3", ErrorCode.MESH_UNREADABLE),
        (".xyz", b"# nothing\n", "no points", ErrorCode.MESH_EMPTY),
        (".xyz", b"0,5 0 0\n", "decimal comma", ErrorCode.MESH_UNREADABLE),
        (".pcd", b"FIELDS x y\n", "no line 'DATA'", ErrorCode.MESH_UNREADABLE),
        (".pcd", pcd(np.zeros((5, 3)), declared=9), "declares 9 points and holds 5",
         ErrorCode.MESH_UNREADABLE),
        (".pcd", pcd(np.full((5, 3), np.nan)), "no points", ErrorCode.MESH_EMPTY),
        (".pcd", pcd(np.zeros((5, 3)), "zipped"), "are 'zipped'", ErrorCode.MESH_UNREADABLE),
        (".pcd", pcd(np.zeros((5, 3)), "binary_compressed")[:-1], "compressed bytes and holds",
         ErrorCode.MESH_UNREADABLE),
        (".pcd", pcd(np.zeros((5, 3)), "binary_compressed", declared=9), "9 points take 144 bytes",
         ErrorCode.MESH_UNREADABLE),
        (".ply", ply([[0, 0, np.inf]]), "not finite", ErrorCode.MESH_NOT_FINITE),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_with_its_reason(suffix, data, words, code):
    with pytest.raises(MeshError) as caught:
        read(data, suffix)
    assert words in caught.value.message
    assert caught.value.code == code, caught.value.message


def test_a_compressed_pcd_holds_the_points_of_the_plain_one(cloud):
    packed = pcd(cloud[0], "binary_compressed", viewpoint=(1, 2, 3))
    found, plain = read(packed, ".pcd"), read(pcd(cloud[0], viewpoint=(1, 2, 3)), ".pcd")
    np.testing.assert_array_equal(found.points, plain.points)
    np.testing.assert_array_equal(found.viewpoints, plain.viewpoints)


def test_too_many_points_are_refused_from_the_header(cloud):
    with pytest.raises(MeshError, match="500 points, the limit is 100"):
        READERS[".ply"](ply(cloud[0]), "part.ply", 100)


def test_a_part_of_a_cloud_says_so_and_has_an_uncertainty(cloud, tmp_path):
    seen = cloud[0][cloud[1][:, 2] > 0.1]
    (tmp_path / "ball.ply").write_bytes(ply(1000.0 * seen, camera=1000.0 * EYE))
    (tmp_path / "ball.yaml").write_text("unit: mm\nmass: 0.2\n")
    part = MeshCatalogue([tmp_path], SMALL).load("ball")
    radii = np.linalg.norm(part.mesh.vertices - CENTER, axis=1)
    assert np.abs(radii - RADIUS)[part.mesh.vertices[:, 2] > CENTER[2]].mean() < 0.001
    assert part.mass == 0.2
    assert part.watertight
    assert len(part.uncertainty.draws) == 2
    assert any(f"cloud of {len(seen)} points" in note for note in part.notes)
    assert any("1 viewpoint given" in note for note in part.notes)


def test_the_yaml_files_viewpoints_count_before_the_files_own(cloud, tmp_path):
    path = tmp_path / "ball.pcd"
    path.write_bytes(pcd(cloud[0], viewpoint=EYE))
    path.with_suffix(".yaml").write_text(f"unit: m\nviewpoints: [{EYE.tolist()}, [0.1, 0, -0.1]]\n")
    assert any("2 viewpoints given" in note for note in load_part(path, settings=SMALL).notes)
    path.with_suffix(".yaml").write_text("viewpoints: [[0, 0]]\n")
    with pytest.raises(MeshError, match="a viewpoint"):
        load_part(path, settings=SMALL)


def test_a_body_of_a_cloud_is_refused(cloud, tmp_path):
    path = tmp_path / "ball.xyz"
    path.write_bytes(xyz(cloud[0]))
    with pytest.raises(MeshError, match="no bodies to choose from"):
        load_part(path, "m", SMALL, body=1)


def test_where_a_mesh_is_wanted_a_cloud_is_refused(cloud, tmp_path):
    for name, data in (("ball.xyz", xyz(cloud[0])), ("ball.ply", ply(cloud[0]))):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(MeshError, match="point cloud"):
            load_mesh(tmp_path / name, "m")


def test_a_ply_file_with_faces_is_the_mesh_that_it_was(tmp_path):
    path = tmp_path / "box.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0\n0.05 0 0\n0 0.05 0\n0 0 0.05\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
    )
    part = load_part(path, "m")
    assert part.uncertainty is None
    assert part.mesh.content_hash == load_mesh(path, "m")[0].content_hash
    assert len(part.mesh.faces) == 4
