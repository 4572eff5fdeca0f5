"""Shapes of a URDF's links: primitives of known volume, mesh files, scales, packages, hulls."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.errors import MeshError, RequestError
from gpis_grasp_planner.hand.link_mesh import convex_hull, solid_properties, write_stl
from gpis_grasp_planner.hand.link_shapes import link_shapes, mesh_path, read_link_mesh

CUBE = convex_hull([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 2)])


def shapes(folder, geometry, kind="collision", **options):
    shape = f'<origin xyz="0 0 1"/><geometry>{geometry}</geometry>'
    link = ET.fromstring(f'<link name="a"><{kind}>{shape}</{kind}></link>')
    [[mesh]] = link_shapes(folder / "r.urdf", [link], kind, **options)
    return mesh


@pytest.mark.parametrize(
    ("geometry", "volume", "extents"),
    [
        ('<box size="0.2 0.3 0.4"/>', 0.2 * 0.3 * 0.4, (0.2, 0.3, 0.4)),
        ('<cylinder radius="0.1" length="0.5"/>', np.pi * 0.01 * 0.5, (0.2, 0.2, 0.5)),
        ('<sphere radius="0.1"/>', 4.0 / 3.0 * np.pi * 1e-3, (0.2, 0.2, 0.2)),
    ],
)
def test_primitives_are_closed_convex_and_of_their_size(tmp_path, geometry, volume, extents):
    mesh = shapes(tmp_path, geometry)
    body = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    assert body.is_watertight
    assert body.is_winding_consistent
    found, centre, _ = solid_properties(mesh)
    assert found == pytest.approx(volume, rel=0.04)
    assert found <= volume + 1e-12  # inside of the true body, outwards faces
    np.testing.assert_allclose(centre, [0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), extents, atol=1e-12)
    heights = mesh.vertices @ mesh.face_normals_outward.T - np.einsum(
        "ij,ij->i", mesh.face_normals_outward, mesh.triangles[:, 0]
    )
    assert heights.max() < 1e-9


@pytest.mark.parametrize("ending", ["stl", "ascii.stl", "obj", "ply", "off"])
def test_mesh_files_of_all_formats_are_the_same_body(tmp_path, ending):
    body = trimesh.Trimesh(CUBE.vertices, CUBE.faces)
    kind = "stl_ascii" if ending == "ascii.stl" else ending
    body.export(tmp_path / f"cube.{ending}", file_type=kind)
    mesh = shapes(tmp_path, f'<mesh filename="cube.{ending}"/>')
    assert len(mesh.vertices) == 8
    assert solid_properties(mesh)[0] == pytest.approx(2.0, rel=1e-6)
    np.testing.assert_allclose(mesh.bounds, [[0, 0, 1], [1, 1, 3]], atol=1e-6)


@pytest.mark.parametrize("scale", ["0.001 0.001 0.001", "-0.001 0.001 0.001", "0.001 0.002 0.001"])
def test_a_mesh_is_scaled_and_looks_outwards_when_mirrored(tmp_path, scale):
    write_stl(CUBE, tmp_path / "cube.stl")
    mesh = shapes(tmp_path, f'<mesh filename="cube.stl" scale="{scale}"/>')
    factors = np.array([float(x) for x in scale.split()])
    volume, _, _ = solid_properties(mesh)
    assert volume == pytest.approx(2.0 * np.abs(factors).prod(), rel=1e-6)
    np.testing.assert_allclose(
        np.ptp(mesh.vertices, axis=0), np.abs(factors) * [1, 1, 2], rtol=1e-6
    )


def test_a_package_is_found_above_the_urdf_beside_it_and_by_the_environment(tmp_path, monkeypatch):
    urdf = tmp_path / "ws/src/my_hand/urdf/r.urdf"
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'nowhere'}:{tmp_path / 'install'}")
    places = {
        "my_hand": tmp_path / "ws/src/my_hand/meshes",
        "other": tmp_path / "ws/src/other/meshes",
        "installed": tmp_path / "install/share/installed/meshes",
    }
    for package, folder in places.items():
        folder.mkdir(parents=True)
        write_stl(CUBE, folder / "a b.stl")
        found = mesh_path(urdf, f"package://{package}/meshes/a%20b.stl")
        assert found.samefile(folder / "a b.stl")
    assert mesh_path(urdf, f"file://{places['other']}/x.stl") == places["other"] / "x.stl"
    assert mesh_path(urdf, "meshes/x.stl") == urdf.parent / "meshes/x.stl"
    with pytest.raises(MeshError, match="Source the workspace"):
        mesh_path(urdf, "package://missing/meshes/x.stl")


def test_a_shape_of_many_corners_is_refused_or_taken_as_its_hull(tmp_path):
    body = trimesh.creation.torus(0.04, 0.012, 40, 40)
    body.export(tmp_path / "ring.stl")
    with pytest.raises(RequestError, match=r"1600 corners.*collision_hulls: true"):
        shapes(tmp_path, '<mesh filename="ring.stl"/>')
    hull = shapes(tmp_path, '<mesh filename="ring.stl"/>', hulls=True)
    assert len(hull.vertices) <= 256
    true = body.convex_hull
    assert solid_properties(hull)[0] == pytest.approx(true.volume, rel=0.02)
    assert len(shapes(tmp_path, '<mesh filename="ring.stl"/>', "visual").vertices) == 1600


@pytest.mark.parametrize(
    ("geometry", "error", "said"),
    [
        ('<capsule radius="1" length="1"/>', RequestError, "'capsule'; give a box, a cylinder"),
        ("", RequestError, "shape that is 'nothing'"),
        ('<mesh filename="hand.dae"/>', MeshError, "not of a known format"),
        ('<mesh filename="missing.obj"/>', MeshError, "No such file"),
        ('<mesh filename="missing.stl"/>', MeshError, "No such file"),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path, geometry, error, said):
    with pytest.raises(error, match=said):
        shapes(tmp_path, geometry)


def test_stl_round_trip_keeps_the_solid(tmp_path):
    mesh = CUBE
    write_stl(mesh, tmp_path / "box.stl")
    back = read_link_mesh(tmp_path / "box.stl")
    assert len(back.vertices) == 8
    np.testing.assert_array_equal(back.triangles, mesh.triangles)


@pytest.mark.parametrize("length", [0, 40, 84, 200])
def test_a_truncated_stl_is_refused(tmp_path, length):
    path = tmp_path / "box.stl"
    write_stl(CUBE, path)
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(MeshError, match=r"box\.stl"):
        read_link_mesh(path)


def test_an_obj_file_without_a_last_newline_is_whole_where_it_is_closed(tmp_path):
    """As trimesh and what builds on it writes them."""
    text = trimesh.Trimesh(CUBE.vertices, CUBE.faces).export(file_type="obj")
    (tmp_path / "cube.obj").write_text(text.rstrip("\n"))
    mesh = shapes(tmp_path, '<mesh filename="cube.obj"/>')
    assert solid_properties(mesh)[0] == pytest.approx(2.0, rel=1e-6)


def test_an_open_obj_file_without_a_last_newline_is_whole_where_its_faces_use_all_corners(tmp_path):
    text = trimesh.Trimesh(CUBE.vertices, CUBE.faces[:-1]).export(file_type="obj")
    (tmp_path / "cube.obj").write_text(text.rstrip("\n"))
    mesh = shapes(tmp_path, '<mesh filename="cube.obj"/>', hulls=True)
    assert solid_properties(mesh)[0] == pytest.approx(2.0, rel=1e-6)


def test_an_obj_file_that_was_cut_off_within_its_faces_is_refused_but_may_be_looked_at(tmp_path):
    text = trimesh.Trimesh(CUBE.vertices, CUBE.faces).export(file_type="obj")
    lines = text.rstrip("\n").split("\n")
    at = next(i for i, line in enumerate(lines) if line.startswith("f "))
    (tmp_path / "cube.obj").write_text("\n".join(lines[: at + 2]))
    with pytest.raises(MeshError, match="its surface is open"):
        shapes(tmp_path, '<mesh filename="cube.obj"/>', hulls=True)
    assert len(shapes(tmp_path, '<mesh filename="cube.obj"/>', kind="visual").faces) == 2
