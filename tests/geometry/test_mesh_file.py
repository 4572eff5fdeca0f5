"""Mesh files: every format gives the same mesh, and every bad file its code and a reason."""

from __future__ import annotations

import hashlib
import os
import re
import struct
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry import mesh_file
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.mesh_file import load_mesh, parse_mesh

FORMATS = {
    "binary.stl": "binary_stl",
    "ascii.stl": "ascii_stl",
    "box.obj": "obj",
    "box.off": "off",
    "ascii.ply": "ascii_ply",
    "binary.ply": "binary_ply",
}


def refused(path: Path, unit: str = "m", limits: CatalogueSettings | None = None) -> MeshError:
    with pytest.raises(MeshError) as caught:
        load_mesh(path, unit, limits)
    assert str(path.parent) not in caught.value.message, "a path leaks"
    return caught.value


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_box(name, write, mesh_path):
    data = getattr(write, FORMATS[name])(*write.box_arrays())
    mesh, report = load_mesh(mesh_path(data, name), "m")
    assert len(mesh.vertices) == 8
    assert len(mesh.faces) == 12
    assert mesh.faces.dtype == np.int32
    np.testing.assert_allclose(mesh.extent, write.box_size, rtol=1e-7)
    assert report.watertight
    assert report.volume == pytest.approx(np.prod(write.box_size), rel=1e-6)
    np.testing.assert_allclose(report.center_of_volume, 0.0, atol=1e-9)
    assert report.file_sha256 == hashlib.sha256(data).hexdigest()
    assert report.notes == ()


def test_formats_with_full_precision_have_one_content_hash(write, mesh_path):
    box = write.box_arrays()
    hashes = {
        load_mesh(mesh_path(getattr(write, kind)(*box), name), "m")[0].content_hash
        for name, kind in FORMATS.items()
        if name != "binary.stl"
    }
    assert len(hashes) == 1


def test_big_endian_ply_is_read(write, mesh_path):
    mesh, _ = load_mesh(mesh_path(write.binary_ply(*write.box_arrays(), order=">"), "b.ply"), "m")
    np.testing.assert_array_equal(np.sort(mesh.extent), np.sort(write.box_size))


def test_millimetres_become_metres(write, mesh_path):
    vertices, faces = write.box_arrays()
    mesh, report = load_mesh(mesh_path(write.obj(1000 * vertices, faces), "b.obj"), "mm")
    np.testing.assert_allclose(mesh.extent, write.box_size, rtol=1e-12)
    assert report.unit == "mm"


def test_an_obj_may_use_polygons_textures_and_negative_indices(write, mesh_path):
    vertices, _ = write.box_arrays()
    text = "mtllib missing.mtl\nusemtl none\no box\n"
    text += "".join(f"v {x} {y} {z} 1.0\n" for x, y, z in vertices)
    text += "vt 0 0\nvn 0 0 1\ns off\n# a comment\n"
    text += "f 1/1/1 2/1/1 4/1/1 3/1/1\nf 5//1 7//1 8//1 6//1\nf 1/1 5/1 \\\n6/1 2/1\n"
    text += "f -6 -5 -1 -2\nf -8 -6 -2 -4\nf -7 -3 -1 -5\n"
    mesh, report = load_mesh(mesh_path(text.encode(), "box.obj"), "m")
    assert report.watertight
    assert report.volume == pytest.approx(np.prod(write.box_size), rel=1e-12)
    assert len(mesh.faces) == 12


@pytest.mark.parametrize("name", FORMATS)
def test_a_truncated_file_is_refused_wherever_it_is_cut(name, write):
    """Any proper start of a file is refused, or lacks nothing but its end of line or its name.

    OBJ alone has no counts and no end mark: cut exactly between two faces it is a whole file of
    an open mesh, and loads as such, with a note. An ASCII STL cut behind its last facet is whole
    by its surface, and says what is missing.
    """
    data = getattr(write, FORMATS[name])(*write.box_arrays())
    suffix = Path(name).suffix
    limits = CatalogueSettings()
    whole = parse_mesh(data, suffix, "m", name, limits)[0].content_hash
    for cut in range(1, len(data)):
        try:
            mesh, report = parse_mesh(data[:cut], suffix, "m", name, limits)
        except MeshError:
            continue
        if suffix == ".obj" and data[cut - 1 : cut] == b"\n":
            assert not report.watertight
            assert any("open" in note for note in report.notes)
            continue
        assert mesh.content_hash == whole, f"cut at {cut} of {len(data)}"
        rest = data[cut:].lstrip()
        if not b"test\n".endswith(rest):
            assert b"endsolid test\n".endswith(rest), rest
            assert any("'endsolid'" in note for note in report.notes)


@pytest.mark.parametrize("name", FORMATS)
@given(data=st.data())
@settings(max_examples=60)
def test_a_damaged_file_never_gives_a_broken_mesh(name, write, data):
    """Any one byte changed: the project's own error, or a mesh that is what it says."""
    content = bytearray(getattr(write, FORMATS[name])(*write.box_arrays()))
    position = data.draw(st.integers(0, len(content) - 1))
    content[position] = data.draw(st.integers(0, 255))
    try:
        mesh, report = parse_mesh(bytes(content), Path(name).suffix, "m", name, CatalogueSettings())
    except MeshError:
        return
    assert np.isfinite(mesh.vertices).all()
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)
    assert (mesh.face_areas > 0).all()
    assert report.volume > 0
    assert 0.005 <= mesh.extent.max() <= 1.0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", FORMATS)
def test_coordinates_that_are_not_finite(name, value, write, mesh_path):
    vertices, faces = write.box_arrays()
    vertices[7, 1] = value
    error = refused(mesh_path(getattr(write, FORMATS[name])(vertices, faces), name))
    assert error.code == ErrorCode.MESH_NOT_FINITE
    assert re.search(r"(face|vertex) \d+", error.message)


def test_all_vertices_nan_in_a_binary_stl(write, mesh_path):
    vertices, faces = write.box_arrays()
    error = refused(mesh_path(write.binary_stl(np.full_like(vertices, np.nan), faces)))
    assert error.code == ErrorCode.MESH_NOT_FINITE
    assert "face 1 " in error.message
    assert "12" in error.message


@pytest.mark.parametrize("name", FORMATS)
def test_absurd_coordinates_name_the_face(name, write, mesh_path):
    vertices, faces = write.box_arrays()
    vertices[0, 0] = 1e38
    error = refused(mesh_path(getattr(write, FORMATS[name])(vertices, faces), name))
    assert error.code == ErrorCode.MESH_EXTENT_IMPLAUSIBLE
    first = 1 + next(i for i, f in enumerate(faces) if 0 in f)
    assert f"face {first} " in error.message
    assert "1e+38" in error.message


@pytest.mark.parametrize(
    ("index", "shown"), [(0, "index 0"), (9, "index 9"), (-9, "index -9"), (10**30, "10000")]
)
def test_obj_indices_out_of_range(index, shown, write, mesh_path):
    data = write.obj(*write.box_arrays()) + f"f 1 2 {index}\n".encode()
    error = refused(mesh_path(data, "box.obj"))
    assert error.code == ErrorCode.MESH_BAD_INDEX
    assert "face 13 (line 21)" in error.message
    assert shown in error.message


@pytest.mark.parametrize("index", [8, -1, 10_000])
@pytest.mark.parametrize("name", ["box.off", "ascii.ply", "binary.ply"])
def test_indices_out_of_range(name, index, write, mesh_path):
    vertices, faces = write.box_arrays()
    faces[4, 1] = index
    error = refused(mesh_path(getattr(write, FORMATS[name])(vertices, faces), name))
    assert error.code == ErrorCode.MESH_BAD_INDEX
    assert "face 5 " in error.message
    assert str(index) in error.message


@pytest.mark.parametrize("name", FORMATS)
def test_a_face_without_area_is_named(name, write, mesh_path):
    vertices, faces = write.box_arrays()
    faces = np.vstack([faces, [[3, 3, 5]]])
    path = mesh_path(getattr(write, FORMATS[name])(vertices, faces), name)
    error = refused(path, limits=CatalogueSettings(degenerate_faces="refuse"))
    assert error.code == ErrorCode.MESH_DEGENERATE
    assert "face 13 " in error.message
    _, report = load_mesh(path, "m", CatalogueSettings(degenerate_faces="drop"))
    assert report.watertight
    assert report.notes == ("1 faces without area were dropped.",)


@pytest.mark.parametrize("claimed", [11, 13, 2**31, 2**32 - 1])
def test_a_lying_face_count_of_a_binary_stl(claimed, write, mesh_path):
    error = refused(mesh_path(write.binary_stl(*write.box_arrays(), count=claimed)))
    assert error.code == ErrorCode.MESH_UNREADABLE
    assert f"{claimed} faces" in error.message


@pytest.mark.parametrize(
    ("name", "data", "code"),
    [
        ("zero.stl", b"", ErrorCode.MESH_EMPTY),
        ("blank.obj", b" \n\n", ErrorCode.MESH_EMPTY),
        ("no_faces.stl", b"x" * 80 + bytes(4), ErrorCode.MESH_EMPTY),
        ("no_facets.stl", b"solid a\nendsolid a\n", ErrorCode.MESH_EMPTY),
        ("points.obj", b"v 0 0 0\nv 0 0 1\nv 0 1 0\n", ErrorCode.MESH_EMPTY),
        ("empty.off", b"OFF\n0 0 0\n", ErrorCode.MESH_EMPTY),
        ("cloud.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n",
         ErrorCode.MESH_EMPTY),
        ("short.stl", b"x" * 40, ErrorCode.MESH_UNREADABLE),
        ("text.stl", b"this is a letter, not a mesh, and it is longer than a header of an STL file "
         b"would be", ErrorCode.MESH_UNREADABLE),
        ("no_end.stl", b"solid a\nfacet normal 0 0 1\nouter loop\n", ErrorCode.MESH_UNREADABLE),
        ("other.ply", b"plx\n", ErrorCode.MESH_UNREADABLE),
        ("header.ply", b"ply\nformat ascii 1.0\nelement vertex 8\n", ErrorCode.MESH_UNREADABLE),
        ("kind.ply", b"ply\nformat zip 1.0\nelement vertex 1\nproperty float x\nelement face 1\n"
         b"property list uchar int vertex_indices\nend_header\n", ErrorCode.MESH_UNREADABLE),
        ("type.ply", b"ply\nformat ascii 1.0\nelement vertex 1\nproperty quad x\nend_header\n",
         ErrorCode.MESH_UNREADABLE),
        ("minus.ply", b"ply\nformat ascii 1.0\nelement vertex -1\nproperty float x\nend_header\n",
         ErrorCode.MESH_UNREADABLE),
        ("colours.off", b"COFF\n3 1 0\n", ErrorCode.MESH_UNREADABLE),
        ("four.off", b"4OFF\n3 1 0\n", ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
        ("words.off", b"OFF\nmany some 0\n", ErrorCode.MESH_UNREADABLE),
        ("two_corners.obj", b"v 0 0 0\nv 0 0 1\nf 1 2\n", ErrorCode.MESH_UNREADABLE),
        ("words.obj", b"v zero 0 0\n", ErrorCode.MESH_UNREADABLE),
        ("index.obj", b"v 0 0 0\nf a b c\n", ErrorCode.MESH_UNREADABLE),
        ("other.step", b"PK\x03\x04", ErrorCode.MESH_UNREADABLE),
        ("cut.step", b"ISO-10303-21;\nHEADER;\n", ErrorCode.MESH_UNREADABLE),
        ("hollow.step", b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n",
         ErrorCode.MESH_EMPTY),
        ("cut.3mf", b"PK\x03\x04", ErrorCode.MESH_UNREADABLE),
        ("cut.glb", b"glTF", ErrorCode.MESH_UNREADABLE),
        ("scene.gltf", b"{}", ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
        ("part.stl.gz", b"\x1f\x8b", ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
        ("scene.dae", b"<?xml?>", ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
        ("none", b"v 0 0 0", ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    ],
)  # fmt: skip
def test_files_that_are_no_mesh(name, data, code, mesh_path):
    error = refused(mesh_path(data, name))
    assert error.code == code, error.message
    assert name in error.message


@pytest.mark.parametrize("name", FORMATS)
def test_too_many_faces_are_refused(name, write, mesh_path):
    vertices, faces = write.box_arrays()
    data = getattr(write, FORMATS[name])(vertices, np.vstack([faces] * 10))
    error = refused(mesh_path(data, name), limits=CatalogueSettings(max_faces=100))
    assert error.code == ErrorCode.MESH_TOO_LARGE
    assert "120 faces" in error.message
    assert "100" in error.message


def test_a_large_file_is_refused_from_its_size(mesh_path):
    path = mesh_path(b"")
    os.truncate(path, 10**12)  # a sparse terabyte: reading it would not end
    error = refused(path)
    assert error.code == ErrorCode.MESH_TOO_LARGE
    assert "1000000000000 bytes" in error.message


@pytest.mark.parametrize("name", ["pipe.stl", "device.stl", "folder.stl"])
def test_neither_a_pipe_nor_a_device_is_opened(name, tmp_path):
    os.mkfifo(tmp_path / "pipe.stl")
    (tmp_path / "device.stl").symlink_to("/dev/zero")
    (tmp_path / "folder.stl").mkdir()
    errors: list[MeshError] = []
    thread = threading.Thread(target=lambda: errors.append(refused(tmp_path / name)), daemon=True)
    thread.start()
    thread.join(timeout=20)
    assert errors, f"{name} blocks"
    assert "not a regular file" in errors[0].message


def test_a_missing_file(tmp_path):
    error = refused(tmp_path / "gone.stl")
    assert error.code == ErrorCode.MESH_UNREADABLE
    assert "gone.stl" in error.message


@pytest.mark.parametrize(
    ("scale", "unit", "cure"),
    [
        (1000.0, "m", "unit: mm"),
        (1.0, "mm", "unit: m'"),
        (0.001, "m", "twice"),
        (1e5, "m", "scale"),
        (0.05, "m", "scale"),
    ],
)
def test_an_implausible_extent_names_its_measure_and_cure(scale, unit, cure, write, mesh_path):
    vertices, faces = write.box_arrays()
    error = refused(mesh_path(write.obj(vertices * scale, faces), "b.obj"), unit)
    assert error.code == ErrorCode.MESH_EXTENT_IMPLAUSIBLE
    measured = write.box_size * scale * (0.001 if unit == "mm" else 1.0)
    for length in measured:
        assert f"{length:.4g}" in error.message
    assert cure in error.message
    assert "0.005 to 1 m" in error.message


def test_the_papers_smallest_and_a_long_part_pass(write, mesh_path):
    for size in ((0.016, 0.016, 0.016), (0.057, 0.203, 0.052), (1.0, 0.1, 0.1)):
        load_mesh(mesh_path(write.obj(*write.box_arrays(size)), "b.obj"), "m")


def test_an_unknown_unit(write, mesh_path):
    error = refused(mesh_path(write.obj(*write.box_arrays()), "b.obj"), "foot")
    assert error.code == ErrorCode.MESH_SIDECAR_INVALID


@pytest.mark.parametrize("name", ["binary.stl", "binary.ply"])
def test_bytes_after_the_last_face_are_noted(name, write, mesh_path):
    data = getattr(write, FORMATS[name])(*write.box_arrays())
    _, report = load_mesh(mesh_path(data + b"more", name), "m")
    assert report.watertight
    assert any(note.startswith("4 bytes after") for note in report.notes)


@pytest.mark.parametrize("name", ["binary.stl", "binary.ply"])
def test_bytes_that_may_be_faces_are_not_dropped(name, write, mesh_path):
    """A count that is one too small, before all faces: the surface would lack one."""
    vertices, faces = write.box_arrays()
    data = getattr(write, FORMATS[name])(vertices, faces)
    if name == "binary.stl":
        data = write.binary_stl(vertices, faces, count=11)
    else:
        data = data.replace(b"element face 12", b"element face 11")
    assert "not read whole" in refused(mesh_path(data, name)).message


def test_an_stl_that_counts_no_faces_is_read_by_its_length(write, mesh_path):
    _, report = load_mesh(mesh_path(write.binary_stl(*write.box_arrays(), count=0)), "m")
    assert report.watertight
    assert any("counts no faces" in note for note in report.notes)


def test_a_binary_stl_may_start_with_solid(write, mesh_path):
    data = bytearray(write.binary_stl(*write.box_arrays()))
    data[:6] = b"solid "
    assert load_mesh(mesh_path(bytes(data)), "m")[1].watertight


def test_ply_with_other_properties_and_elements(write, mesh_path):
    vertices, faces = write.box_arrays()
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment made by a test\nelement vertex 8\n"
        "property float x\nproperty float y\nproperty float z\nproperty uchar red\n"
        "element face 12\nproperty list uchar int vertex_indices\nproperty uchar flags\n"
        "element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    )
    body = b"".join(struct.pack("<3fB", *v, 255) for v in vertices)
    body += b"".join(struct.pack("<B3iB", 3, *f, 0) for f in faces)
    data = header.encode() + body + struct.pack("<2i", 0, 1)
    assert load_mesh(mesh_path(data, "b.ply"), "m")[1].watertight


def test_importing_does_not_load_the_mesh_library():
    code = (
        "import sys, gpis_grasp_planner.geometry.catalogue as c\n"
        "assert not {'trimesh', 'cascadio', 'manifold3d'} & set(sys.modules)"
    )
    package = Path(mesh_file.__file__).parents[2]
    subprocess.run(
        [sys.executable, "-c", code], check=True, env={**os.environ, "PYTHONPATH": str(package)}
    )
