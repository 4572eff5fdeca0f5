"""Random solids in random legal dialects of each format come back as the same shape.

The solids are prisms over concave outlines, turned and moved. Two oracles: the exact volume and
bounds, and trimesh as an independent reader where it reads the form at all.
"""

from __future__ import annotations

import io
import struct

import mesh_dialects as d
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_dialects import Solid
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.mesh_file import READERS, parse_mesh

LIMITS = CatalogueSettings()


@st.composite
def solids(draw) -> Solid:
    n = draw(st.integers(3, 10))
    radii = np.array(draw(st.lists(st.floats(10.0, 40.0), min_size=n, max_size=n)))
    angles = 2 * np.pi * np.arange(n) / n
    outline = np.column_stack([np.cos(angles), np.sin(angles)]) * radii[:, None]
    solid = d.prism(outline, draw(st.floats(5.0, 60.0)))
    turn = Rotation.random(rng=draw(st.integers(0, 2**32 - 1))).as_matrix()
    shift = draw(st.sampled_from([(0, 0, 0), (100, -50, 20)]))
    return Solid(solid.vertices @ turn.T + shift, solid.polygons, solid.volume)


def _text(draw, data: bytes, comment: str = "#") -> bytes:
    """Line ends, blanks and comments as one likes, none of which means anything."""
    lines = data.decode().split("\n")
    if comment and draw(st.booleans()):
        lines = [f"{line} {comment} note 1 2 3" if line else line for line in lines]
        lines.insert(0, f"{comment} made by a test")
    if draw(st.booleans()):
        lines = [line.replace(" ", draw(st.sampled_from(["\t", "  ", " \t"]))) for line in lines]
    if comment and draw(st.booleans()):
        lines = [draw(st.sampled_from(["", " ", "\t"])) + line for line in lines]
    text = draw(st.sampled_from(["\n", "\r\n", "\r"])).join(lines).encode()
    return (b"\xef\xbb\xbf" if draw(st.booleans()) else b"") + text


@st.composite
def obj_files(draw) -> tuple[bytes, Solid]:
    solid = draw(solids())
    corner = draw(st.sampled_from(["{0}", "{0}/1", "{0}//1", "{0}/1/1", "{0}/-1/-1"]))
    relative = draw(st.booleans())
    colours = draw(st.sampled_from(["", " 1.0", " 0.5 0.5 0.5"]))
    faces = d.f_lines(solid, corner=corner, relative=relative)
    before = "vt 0 0\nvn 0 0 1\n" + draw(st.sampled_from(["", "o part\n", "g a b\ns 1\n"]))
    others = draw(st.sampled_from(["", "v 9 9 9\n"]))  # a vertex that no face uses
    text = before + d.v_lines(solid, end=colours) + faces + others
    if draw(st.booleans()):
        text = text.replace(" ", " \\\n", draw(st.integers(1, 30)))
    return _text(draw, text.encode(), "" if "\\" in text else "#"), solid


@st.composite
def off_files(draw) -> tuple[bytes, Solid]:
    solid = draw(solids())
    kind, more = draw(
        st.sampled_from(
            [("OFF", ""), ("COFF", " 1 2 3 4"), ("NOFF", " 0 0 1"), ("STOFF", " 0 1"),
             ("CNOFF", " 0 0 1 1 2 3 4"), ("off", ""), ("", "")]
        )
    )  # fmt: skip
    counts = draw(st.sampled_from(["\n{v} {f} {e}\n", " {v} {f} 0\n", "\n{v} {f}\n"]))
    colours = draw(st.sampled_from(["", " 1", " 9 9 9", " 0.5 0.5 0.5 1.0"]))
    data = d.off(solid, kind + counts, vertex_end=more, face_end=colours)
    return _text(draw, data), solid


@st.composite
def ply_files(draw) -> tuple[bytes, Solid]:
    solid = draw(solids())
    if draw(st.booleans()):
        more, colours = draw(st.sampled_from([("", ()), (" 9 8", ("uchar red", "int a"))]))
        data = d.ascii_ply(solid, vertex_end=more, vertex=("double x", "double y", "double z",
                                                           *colours))  # fmt: skip
        return _text(draw, data, ""), solid
    order = draw(st.sampled_from("<>"))
    lists, pack = draw(
        st.sampled_from(
            [(d.CORNERS, "B{n}i"), ("list int uint vertex_index", "i{n}I"),
             ("list ushort uchar vertex_indices", "H{n}B")]
        )
    )  # fmt: skip
    after = draw(st.sampled_from([b"", b"\n", b"\0\0"]))
    return d.binary_ply(solid, order, lists, pack) + after, solid


@st.composite
def stl_files(draw) -> tuple[bytes, Solid]:
    solid = draw(solids())
    n = len(solid.vertices) // 2
    # STL has triangles only: the two caps as fans around a corner need a convex outline.
    middle = solid.vertices.reshape(2, n, 3).mean(axis=1)
    fans = [[2 * n, (i + 1) % n, i] for i in range(n)]
    fans += [[2 * n + 1, n + i, n + (i + 1) % n] for i in range(n)]
    sides = [t for p in solid.polygons[2:] for t in ([p[0], p[1], p[2]], [p[0], p[2], p[3]])]
    whole = Solid(np.vstack([solid.vertices, middle]), [*fans, *sides], solid.volume)
    if draw(st.booleans()):
        header = draw(st.sampled_from([b"", b"solid x", b"COLOR="]))
        count = draw(st.sampled_from([None, 0]))
        return d.binary_stl(whole, header, count, attribute=draw(st.sampled_from([0, 99]))), solid
    name = draw(st.sampled_from(["", "a part", "facet", "endsolid vertex"]))
    return _text(draw, d.ascii_stl(whole, name), ""), solid


@st.composite
def scene_files(draw) -> tuple[bytes, Solid]:
    """3MF with a unit, 20 mm to the side."""
    solid = draw(solids())
    unit, size = draw(
        st.sampled_from([("millimeter", 1.0), ("inch", 25.4), ("centimeter", 10.0), ("", 1.0)])
    )
    triangles = [list(t) for t in _triangles(solid)]
    whole = Solid(solid.vertices / size, triangles, solid.volume)
    moved = solid.moved((20, 0, 0))
    return d.simple_3mf(whole, unit, f"1 0 0 0 1 0 0 0 1 {20 / size!r} 0 0"), moved


def _triangles(solid: Solid):
    parsed = READERS[".obj"](d.obj(solid), "a.obj", 1000)
    return parsed.faces.tolist()


FILES = {
    ".obj": obj_files(), ".off": off_files(), ".ply": ply_files(), ".stl": stl_files(),
    ".3mf": scene_files(),
}  # fmt: skip


@pytest.mark.parametrize("suffix", FILES)
@given(data=st.data())
@settings(max_examples=120, deadline=None)
def test_every_dialect_gives_the_same_shape(suffix, data):
    content, solid = data.draw(FILES[suffix])
    mesh, report = parse_mesh(content, suffix, "mm", f"part{suffix}", LIMITS)
    assert report.watertight
    assert report.volume == pytest.approx(1e-9 * solid.volume, rel=1e-4)
    bounds = 1e-3 * np.stack([solid.vertices.min(axis=0), solid.vertices.max(axis=0)])
    np.testing.assert_allclose(mesh.bounds, bounds, atol=1e-8 + 1e-7 * np.abs(bounds).max())
    assert not any("turned" in note or "intersects" in note for note in report.notes)


@pytest.mark.parametrize("suffix", FILES)
@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_a_cut_or_flipped_file_is_no_other_closed_shape(suffix, data):
    """Cut anywhere: refused, open and said so, or whole. A flipped byte: no crash."""
    content, solid = data.draw(FILES[suffix])
    cut = content[: data.draw(st.integers(1, len(content) - 1))]
    try:
        _, report = parse_mesh(cut, suffix, "mm", f"part{suffix}", LIMITS)
    except MeshError:
        pass
    else:
        if report.watertight:
            assert report.volume == pytest.approx(1e-9 * solid.volume, rel=1e-2)
        else:
            assert suffix == ".obj"  # it alone has neither counts nor an end
    flipped = bytearray(content)
    flipped[data.draw(st.integers(0, len(content) - 1))] ^= data.draw(st.integers(1, 255))
    try:
        mesh, _ = parse_mesh(bytes(flipped), suffix, "mm", f"part{suffix}", LIMITS)
    except MeshError:
        return
    assert np.isfinite(mesh.vertices).all()


@pytest.mark.parametrize("part", ["mug", "flange", "bishop"])
@pytest.mark.parametrize("file_type", ["stl", "stl_ascii", "obj", "off", "ply", "glb"])
def test_an_independent_reader_agrees(part, file_type):
    """The shipped parts written by trimesh: its reader and this one have the same triangles."""
    original = trimesh.load(default_catalogue_directory() / f"{part}.stl")
    data = original.export(file_type=file_type)
    data = data.encode() if isinstance(data, str) else data
    suffix = "." + file_type.split("_")[0]
    theirs = trimesh.load(io.BytesIO(data), file_type=suffix[1:], force="mesh", process=False)
    ours = READERS[suffix](data, f"part{suffix}", 100_000)
    expected = np.asarray(theirs.vertices)[np.asarray(theirs.faces)]
    np.testing.assert_allclose(ours.vertices[ours.faces], expected, rtol=1e-6, atol=1e-7)


def test_strips_are_those_of_a_known_solid():
    """One strip with a restart and a joint without area, as converters write them."""
    values = [0, 1, 2, 3, 6, 7, 4, 5, 0, 1, -1, 0, 2, 4, 6, -1, 1, 5, 3, 7]
    head = d.ply_header("binary_big_endian", [("vertex", 8, d.XYZ),
                        ("tristrips", 2, ["list int int vertex_indices"])])  # fmt: skip
    body = b"".join(struct.pack(">3f", *v) for v in d.BOX.vertices)
    body += struct.pack(f">{len(values) + 1}i", len(values), *values)
    body += struct.pack(">5i", 4, 0, 0, 1, 1)  # a strip of joints alone
    parsed = READERS[".ply"](head + body, "a.ply", 1000)
    mesh = trimesh.Trimesh(parsed.vertices, parsed.faces)
    assert len(parsed.faces) == 12
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert abs(mesh.volume) == pytest.approx(d.BOX.volume)
