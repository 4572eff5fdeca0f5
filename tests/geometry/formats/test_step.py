"""STEP: units, damage, readers that crash, assemblies, and what the text promises."""

from __future__ import annotations

import re

import mesh_dialects as d
import numpy as np
import pytest
import step_dialects
from mesh_dialects import BOX

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.formats import step
from gpis_grasp_planner.geometry.mesh_file import load_mesh


def refused(path, unit: str = "m", limits: CatalogueSettings | None = None) -> MeshError:
    with pytest.raises(MeshError) as caught:
        load_mesh(path, unit, limits)
    assert str(path.parent) not in caught.value.message, "a path leaks"
    return caught.value


@pytest.mark.parametrize(
    ("unit", "size"), [(".MILLI.", (60, 50, 40)), ("$", (0.06, 0.05, 0.04)), (".CENTI.", (6, 5, 4))]
)
def test_step_brings_its_own_unit(unit, size, write, mesh_path):
    mesh, report = load_mesh(mesh_path(write.step_box(size, unit), "box.step"), "mm")
    np.testing.assert_allclose(mesh.extent, write.box_size, rtol=1e-6)
    assert report.watertight
    assert report.volume == pytest.approx(np.prod(write.box_size), rel=1e-6)
    assert report.unit == "m"


@pytest.mark.parametrize("code", ["os.kill(os.getpid(), 11)", "sys.exit(3)", "pass"])
def test_a_step_reader_that_crashes_takes_nothing_with_it(code, write, mesh_path, monkeypatch):
    """OpenCASCADE does crash on damaged files; here its process is told to."""
    monkeypatch.setattr(step, "TESSELLATE", f"import os, sys\n{code}")
    error = refused(mesh_path(write.step_box((60, 50, 40)), "box.step"))
    assert error.code == ErrorCode.MESH_UNREADABLE
    assert "damaged" in error.message


def test_a_step_reader_that_hangs_is_ended(write, mesh_path, monkeypatch):
    monkeypatch.setattr(step, "TESSELLATE", "import time\ntime.sleep(600)")
    limits = CatalogueSettings(step_timeout_s=1.0)
    error = refused(mesh_path(write.step_box((60, 50, 40)), "box.step"), limits=limits)
    assert "within 1 s" in error.message


def test_faces_that_are_lost_at_fine_angles_are_read_at_coarse_ones(write, mesh_path, monkeypatch):
    """OpenCASCADE fails at some faces of sound files; here a shell without its first stands in."""
    data = write.step_box((60, 50, 40))
    tessellate = step._tessellate

    def losing_a_face(body, name, timeout_s, angle_rad):
        if angle_rad == step.TOLERANCE_RAD:
            body = re.sub(rb"(CLOSED_SHELL\s*\([^(]*\()\s*#\d+\s*,", rb"\1", body)
        return tessellate(body, name, timeout_s, angle_rad)

    monkeypatch.setattr(step, "_tessellate", losing_a_face)
    _, report = load_mesh(mesh_path(data, "box.step"), "mm")
    assert report.watertight
    assert report.volume == pytest.approx(np.prod(write.box_size), rel=1e-6)
    assert any("loses 1 of 6 faces at 0.2 rad" in note for note in report.notes)


def test_damaged_step_files_are_refused_and_nothing_dies(write, mesh_path, rng):
    data = write.step_box((60, 50, 40))
    start = data.index(b"DATA;")
    for _ in range(4):
        damaged = bytearray(data)
        for position in rng.integers(start, len(data) - 60, 3):
            del damaged[position : position + int(rng.integers(1, 100))]
        try:
            _, report = load_mesh(mesh_path(bytes(damaged), "box.step"), "m")
        except MeshError:
            continue
        assert report.volume > 0


SMALL = d.box((20, 20, 20))
PLATE = d.box((80, 60, 5))
PLACED = [("bolt", SMALL, (0, 0, 0)), ("bolt", SMALL, (40, 0, 0)), ("plate", PLATE, (0, 0, 30))]


@pytest.mark.parametrize(
    "data",
    [
        b"\xef\xbb\xbf" + step_dialects.part(BOX),
        b"/* made by hand; ISO */ \n\n" + step_dialects.part(BOX),
        step_dialects.part(BOX) + b" " * 5000 + b"\n",
        step_dialects.part(BOX).replace(b"\n", b"\r\n"),
        step_dialects.part(BOX, name="it''s #7=(a;b)"),
        step_dialects.part(BOX).replace(b"=PRODUCT(", b" = /* one */ PRODUCT ("),
        step_dialects.surfaces(BOX),
    ],
)
def test_unusual_frames_are_read(data, mesh_path):
    _, report = load_mesh(mesh_path(data, "box.step"), "mm")
    assert report.watertight
    assert report.volume == pytest.approx(1e-9 * BOX.volume, rel=1e-5)


def test_a_stray_face_beside_a_closed_solid_is_noted(mesh_path):
    """Construction geometry that belongs to no shell must not cost the part."""
    step_text = step_dialects.StepText()
    items = [step_text.axes(), step_text.brep(BOX)]
    step_text.product("part", items, "FACETED_BREP_SHAPE_REPRESENTATION")
    step_text.faces(d.Solid(BOX.vertices, BOX.polygons[:1], 0.0))
    _, report = load_mesh(mesh_path(step_text.text(), "box.step"), "m")
    assert report.watertight
    assert "OpenCASCADE reads 6 of 7 faces." in report.notes


def test_inches_are_honoured(mesh_path):
    data = step_dialects.part(d.box((2, 1, 1)), inches=True)
    mesh, _ = load_mesh(mesh_path(data, "box.stp"), "mm")
    np.testing.assert_allclose(mesh.extent, (0.0508, 0.0254, 0.0254), rtol=1e-6)


def test_an_assembly_is_one_part_and_names_its_bodies(mesh_path):
    mesh, report = load_mesh(mesh_path(step_dialects.assembly(PLACED), "whole.step"), "m")
    assert report.bodies == 3
    assert report.volume == pytest.approx(1e-9 * (2 * SMALL.volume + PLATE.volume), rel=1e-5)
    np.testing.assert_allclose(mesh.extent, (0.08, 0.06, 0.035), rtol=1e-6)
    assert any("1 'bolt', 2 'bolt (2)', 3 'plate'" in note for note in report.notes)


@pytest.mark.parametrize(
    ("body", "low", "high"),
    [
        ("plate", (0, 0, 30), (80, 60, 35)),
        (3, (0, 0, 30), (80, 60, 35)),
        ("3", (0, 0, 30), (80, 60, 35)),
        ("bolt (2)", (40, 0, 0), (60, 20, 20)),
        (1, (0, 0, 0), (20, 20, 20)),
    ],
)
def test_one_body_is_chosen_by_name_or_number(body, low, high, mesh_path):
    path = mesh_path(step_dialects.assembly(PLACED), "whole.step")
    mesh, report = load_mesh(path, "m", body=body)
    np.testing.assert_allclose(mesh.bounds, 1e-3 * np.array([low, high]), atol=1e-8)
    assert report.watertight
    assert any("only" in note for note in report.notes)


@pytest.mark.parametrize("body", ["nut", 4, 0, "-1"])
def test_a_body_that_is_not_there_lists_those_that_are(body, mesh_path):
    path = mesh_path(step_dialects.assembly(PLACED), "whole.step")
    with pytest.raises(MeshError, match="1 'bolt', 2 'bolt \\(2\\)', 3 'plate'"):
        load_mesh(path, "m", body=body)


def test_solids_of_one_part_are_bodies_too(mesh_path):
    path = mesh_path(step_dialects.part(SMALL, SMALL.moved((50, 0, 0)), name="pair"), "a.step")
    mesh, _ = load_mesh(path, "m", body=2)
    np.testing.assert_allclose(mesh.bounds[:, 0], (0.05, 0.07), atol=1e-8)


def test_open_surfaces_say_that_there_is_no_solid(mesh_path):
    _, report = load_mesh(mesh_path(step_dialects.surfaces(BOX, 5), "sheet.step"), "m")
    assert not report.watertight
    assert any("without a solid" in note for note in report.notes)


def test_a_wireframe_is_no_part(mesh_path):
    error = refused(mesh_path(step_dialects.curves(), "wire.step"))
    assert error.code == ErrorCode.MESH_EMPTY
    assert "wireframe" in error.message


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"FACE_SURFACE(", b"FACE_SURFACX("),
        (b"FACE_OUTER_BOUND(", b"FACE_OUTER_BOOND("),
        (b"POLY_LOOP(''", b"POLY_LOOP('"),
        (b"=PLANE(", b"=PLNE("),
        (b"FACETED_BREP(", b"FACETED_BREQ("),
    ],
)
def test_a_damaged_face_is_not_left_out_in_silence(old, new, mesh_path):
    data = step_dialects.part(SMALL, SMALL.moved((50, 0, 0)))
    error = refused(mesh_path(data.replace(old, new, 1), "box.step"))
    assert error.code == ErrorCode.MESH_UNREADABLE
    assert "damaged" in error.message or "not read whole" in error.message


def test_a_flipped_character_is_refused_or_leaves_a_whole_shape(rng):
    """Any shape that comes out has as many faces as the text, or it is refused."""
    data = step_dialects.part(BOX)
    start, end = data.index(b"#1="), data.rindex(b"ENDSEC")
    for _ in range(12):
        damaged = bytearray(data)
        for at in rng.integers(start, end, 3):
            damaged[at] = int(rng.integers(33, 127))
        try:
            parsed = step.read_step(bytes(damaged), "box.step", 10_000, 60.0)
        except MeshError:
            continue
        assert len(parsed.faces) == 12 or parsed.doubt is not None


@pytest.mark.parametrize("in_parts", [False, True])
@pytest.mark.parametrize(
    ("scale", "axes", "word"),
    [
        (2.0, np.eye(3), "scaled by 2"),
        (0.001, np.eye(3), "scaled by 0.001"),
        (None, np.diag([-1.0, 1.0, 1.0]), "mirrored"),
        (1.0, np.diag([1.0, 1.0, -1.0]), "mirrored"),
    ],
)
def test_copies_that_the_reader_would_place_wrongly_are_refused(
    scale, axes, word, in_parts, mesh_path
):
    error = refused(mesh_path(step_dialects.mapped_copy(SMALL, scale, axes, in_parts), "a.step"))
    assert error.code == ErrorCode.MESH_FORMAT_NOT_SUPPORTED
    assert word in error.message


@pytest.mark.parametrize("scale", [None, 1.0])
def test_copies_that_are_moved_and_turned_are_where_they_belong(scale, mesh_path):
    turned = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    solid = d.box((20, 30, 40))
    mesh, report = load_mesh(
        mesh_path(step_dialects.mapped_copy(solid, scale, turned), "a.step"), "m"
    )
    assert report.volume == pytest.approx(2 * 20 * 30 * 40 * 1e-9, rel=1e-6)
    own = solid.vertices / 1000.0
    copy = own @ turned + [0.1, 0.0, 0.0]
    both = np.concatenate([own, copy])
    np.testing.assert_allclose(mesh.vertices.min(axis=0), both.min(axis=0), atol=1e-7)
    np.testing.assert_allclose(mesh.vertices.max(axis=0), both.max(axis=0), atol=1e-7)


def test_an_operator_that_places_nothing_is_no_matter(mesh_path):
    unused = b"#9001=CARTESIAN_TRANSFORMATION_OPERATOR_3D('','',$,$,$,#9002,2.0,$);\n"
    unused += b"#9002=CARTESIAN_POINT('',(0.,0.,0.));\nENDSEC;\nEND-"
    data = step_dialects.part(SMALL).replace(b"ENDSEC;\nEND-", unused)
    _, report = load_mesh(mesh_path(data, "a.step"), "m")
    assert report.volume == pytest.approx(0.02**3, rel=1e-6)


@pytest.mark.parametrize(("whole", "damaged"), [(b",2.0,", b",two,"), (b",2.0,", b",")])
def test_a_copy_whose_way_is_damaged_is_told(whole, damaged, mesh_path):
    data = step_dialects.mapped_copy(SMALL, 2.0, np.eye(3))
    assert data.count(whole) == 1
    error = refused(mesh_path(data.replace(whole, damaged), "a.step"))
    assert error.code == ErrorCode.MESH_UNREADABLE
    assert "the way of a copy" in error.message


def test_an_axis_that_is_not_given_is_that_of_the_frame(mesh_path):
    """Down with the third and nothing said of the others: the copy is a mirror image."""
    data = step_dialects.mapped_copy(SMALL, 1.0, np.diag([1.0, 1.0, -1.0]))
    operator = data.index(b"OPERATOR_3D('','',$,") + len(b"OPERATOR_3D('','',$,")
    axes = data[operator : data.index(b",", data.index(b",", operator) + 1)]
    error = refused(mesh_path(data.replace(axes, b"$,$"), "a.step"))
    assert "mirrored" in error.message
