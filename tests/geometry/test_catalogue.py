"""IDs to parts: what is found, what is refused, and what the part says of itself."""

from __future__ import annotations

import os
import shutil
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, MeshError, RequestError
from gpis_grasp_planner.geometry import mesh_file
from gpis_grasp_planner.geometry.catalogue import (
    CatalogueSettings,
    MeshCatalogue,
    default_catalogue_directory,
    load_part,
)
from gpis_grasp_planner.geometry.part import Friction


@pytest.fixture
def directory(tmp_path: Path, write) -> Path:
    """A directory with a box in millimetres and its sidecar."""
    folder = tmp_path / "meshes"
    folder.mkdir()
    vertices, faces = write.box_arrays(1000 * write.box_size)
    (folder / "box.stl").write_bytes(write.binary_stl(vertices, faces))
    (folder / "box.yaml").write_text("unit: mm\nmaterial: glass\n")
    return folder


def refused(catalogue: MeshCatalogue, mesh_id: str, directory: Path) -> GraspPlannerError:
    with pytest.raises(GraspPlannerError) as caught:
        catalogue.load(mesh_id)
    assert str(directory) not in caught.value.message, "a path leaks"
    assert "Traceback" not in caught.value.message
    return caught.value


def _fail_on_open(*_args: object, **_options: object) -> None:
    pytest.fail("something was opened")


def test_a_part_with_its_sidecar(directory, write):
    catalogue = MeshCatalogue([directory])
    assert catalogue.ids() == ["box"]
    part = catalogue.load("box")
    assert part.mesh_id == "box"
    np.testing.assert_allclose(part.mesh.extent, write.box_size, rtol=1e-6)
    assert part.volume == pytest.approx(np.prod(write.box_size), rel=1e-6)
    assert part.mass == pytest.approx(2500.0 * part.volume)
    assert part.friction == Friction(0.3, 0.2)
    assert part.watertight
    assert part.notes == ()
    assert catalogue.load("box.stl").mesh.content_hash == part.mesh.content_hash


def test_without_a_sidecar_the_assumptions_are_said(directory, write):
    (directory / "box.yaml").unlink()
    part = MeshCatalogue([directory], CatalogueSettings(default_unit="mm")).load("box")
    np.testing.assert_allclose(part.mesh.extent, write.box_size, rtol=1e-6)
    assert part.mass == pytest.approx(1000.0 * part.volume)
    assert part.friction is None
    assert any("default unit 'mm'" in n for n in part.notes)
    assert any("1000 kg/m3 assumed" in n for n in part.notes)
    error = refused(MeshCatalogue([directory]), "box", directory)  # read in m: 60 m large
    assert error.code == ErrorCode.MESH_EXTENT_IMPLAUSIBLE
    assert "unit: mm" in error.message


def test_mass_and_centre_of_mass_of_the_sidecar_count(directory):
    (directory / "box.yaml").write_text("unit: mm\nmass: 0.25\ncenter_of_mass: [0.01, 0, 0]\n")
    part = MeshCatalogue([directory]).load("box")
    assert part.mass == 0.25
    np.testing.assert_array_equal(part.center_of_mass, (0.01, 0, 0))
    (directory / "box.yaml").write_text("unit: mm\ncenter_of_mass: [10, 0, 0]\n")
    error = refused(MeshCatalogue([directory]), "box", directory)
    assert error.code == ErrorCode.MESH_SIDECAR_INVALID
    assert "metres" in error.message


def test_an_open_mesh_takes_the_centre_of_its_hull_and_says_so(directory, write):
    vertices, faces = write.box_arrays(center=(0.02, 0, 0))
    (directory / "open.obj").write_bytes(write.obj(vertices, faces[2:]))
    part = MeshCatalogue([directory]).load("open")
    assert not part.watertight
    np.testing.assert_allclose(part.center_of_mass, (0.02, 0, 0), atol=1e-12)
    assert any("convex hull" in n for n in part.notes)


@pytest.mark.parametrize(
    "mesh_id",
    [
        "", ".", "..", "../box", "..\\box", "/etc/passwd", "/box", "a//b", "a/../box", "box/",
        "a/.b", "box\0", "box\n",
        "%2e%2e%2fbox", "box%00", "~", "-box", ".box", "a..b", "b ox", "b\u00f6x", "box\u202e",
        "b" * 65, "b" * 100_000,
        "\ud800", "box;rm", "$HOME", "file:box", "*", "bo[x]",
    ],
)  # fmt: skip
def test_ids_outside_the_allow_list(mesh_id, directory, monkeypatch):
    catalogue = MeshCatalogue([directory])
    monkeypatch.setattr(os, "open", _fail_on_open)
    error = refused(catalogue, mesh_id, directory)
    assert isinstance(error, RequestError)
    assert error.code == ErrorCode.INVALID_MESH_ID
    assert error.message.isprintable()
    assert error.message.isascii()
    assert len(error.message) < 400


@given(st.text(max_size=80))
def test_no_text_at_all_leaves_the_catalogue(mesh_id):
    catalogue = MeshCatalogue([default_catalogue_directory()])
    if mesh_id in catalogue.ids():
        return
    with pytest.raises(RequestError) as caught:
        catalogue.load(mesh_id)
    assert caught.value.code in (ErrorCode.INVALID_MESH_ID, ErrorCode.UNKNOWN_MESH)


def test_an_unknown_id_names_the_nearest(directory):
    for name in ("bolt", "boxes", "gear"):
        shutil.copy(directory / "box.stl", directory / f"{name}.stl")
    error = refused(MeshCatalogue([directory]), "Bocks", directory)
    assert error.code == ErrorCode.UNKNOWN_MESH
    assert "'Bocks' is unknown" in error.message
    assert "boxes" in error.message
    assert "gear" not in error.message
    everything = refused(MeshCatalogue([directory]), "qqqq", directory)
    assert "Known IDs: bolt, box, boxes, gear." in everything.message


def test_an_empty_catalogue_says_so(tmp_path):
    assert "empty" in refused(MeshCatalogue([tmp_path]), "box", tmp_path).message


def test_links_pipes_and_devices_are_not_followed(directory, tmp_path, monkeypatch):
    outside = tmp_path / "outside.stl"
    shutil.copy(directory / "box.stl", outside)
    (directory / "link.stl").symlink_to(outside)
    (directory / "dangling.stl").symlink_to(tmp_path / "nothing")
    (directory / "loop.stl").symlink_to(directory / "loop.stl")
    (directory / "zero.stl").symlink_to("/dev/zero")
    os.mkfifo(directory / "pipe.stl")
    (directory / "folder.stl").mkdir()
    catalogue = MeshCatalogue([directory])
    assert catalogue.ids() == ["box"]
    monkeypatch.setattr(os, "open", _fail_on_open)
    for mesh_id in ("link", "dangling", "loop", "zero", "pipe", "folder"):
        error = refused(catalogue, mesh_id, tmp_path)
        assert error.code == ErrorCode.INVALID_MESH_ID, error.message
        assert "regular file inside the catalogue" in error.message


def test_a_sidecar_that_links_out_is_refused(directory, tmp_path):
    (tmp_path / "secret.yaml").write_text("unit: mm\n")
    (directory / "box.yaml").unlink()
    (directory / "box.yaml").symlink_to(tmp_path / "secret.yaml")
    assert refused(MeshCatalogue([directory]), "box", tmp_path).code == ErrorCode.INVALID_MESH_ID


def test_a_link_within_the_catalogue_is_followed(directory):
    (directory / "alias.stl").symlink_to("box.stl")
    (directory / "alias.yaml").symlink_to("box.yaml")
    catalogue = MeshCatalogue([directory])
    assert catalogue.ids() == ["alias", "box"]
    assert catalogue.load("alias").mesh.content_hash == catalogue.load("box").mesh.content_hash


def test_a_stem_with_two_files_takes_the_full_name(directory, write):
    (directory / "box.obj").write_bytes(write.obj(*write.box_arrays(1000 * write.box_size)))
    catalogue = MeshCatalogue([directory])
    assert catalogue.ids() == ["box.obj", "box.stl"]
    error = refused(catalogue, "box", directory)
    assert error.code == ErrorCode.UNKNOWN_MESH
    assert "box.obj, box.stl" in error.message
    assert catalogue.load("box.obj").watertight
    assert catalogue.load("box.stl").watertight


def test_the_first_directory_counts_and_the_others_are_mentioned(directory, tmp_path, write):
    second = tmp_path / "second"
    second.mkdir()
    (second / "box.obj").write_bytes(write.obj(*write.box_arrays((0.2, 0.2, 0.2))))
    (second / "cube.obj").write_bytes(write.obj(*write.box_arrays((0.2, 0.2, 0.2))))
    catalogue = MeshCatalogue([directory, second])
    assert catalogue.ids() == ["box", "cube"]
    part = catalogue.load("box")
    np.testing.assert_allclose(part.mesh.extent, write.box_size, rtol=1e-6)
    assert "1 later catalogue directories also hold 'box'; not used." in part.notes
    assert MeshCatalogue([second, directory]).load("box").mesh.extent[0] == pytest.approx(0.2)


def test_files_that_come_and_go_are_seen(directory):
    catalogue = MeshCatalogue([directory])
    shutil.copy(directory / "box.stl", directory / "new.stl")
    assert catalogue.ids() == ["box", "new"]
    (directory / "box.stl").unlink()
    assert refused(catalogue, "box", directory).code == ErrorCode.UNKNOWN_MESH


def test_a_file_is_read_once_while_it_changes(directory, write, monkeypatch):
    """Replacing the file as soon as it was read changes neither mesh nor hash."""
    before = MeshCatalogue([directory]).load("box").mesh.content_hash
    read = mesh_file.read_regular_file

    def read_then_replace(path: Path, max_bytes: int) -> bytes:
        data = read(path, max_bytes)
        if path.suffix == ".stl":
            path.write_bytes(b"something else")
        return data

    monkeypatch.setattr(
        "gpis_grasp_planner.geometry.catalogue.read_regular_file", read_then_replace
    )
    catalogue = MeshCatalogue([directory])
    assert catalogue.load("box").mesh.content_hash == before
    assert isinstance(refused(catalogue, "box", directory), MeshError)


def test_loading_in_many_threads_gives_one_answer(directory):
    catalogue = MeshCatalogue([directory])
    hashes: list[str] = []
    threads = [
        threading.Thread(target=lambda: hashes.append(catalogue.load("box").mesh.content_hash))
        for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(hashes) == 8
    assert len(set(hashes)) == 1


def test_several_sidecars_are_refused(directory):
    (directory / "box.stl.yml").write_text("unit: m\n")
    error = refused(MeshCatalogue([directory]), "box", directory)
    assert error.code == ErrorCode.MESH_SIDECAR_INVALID
    assert "box.stl.yml, box.yaml" in error.message


def test_a_broken_sidecar_is_not_overlooked(directory):
    (directory / "box.yaml").write_text("units: mm\n")
    error = refused(MeshCatalogue([directory]), "box", directory)
    assert error.code == ErrorCode.MESH_SIDECAR_INVALID
    (directory / "box.yaml").write_text("#" * 100_000)
    assert refused(MeshCatalogue([directory]), "box", directory).code == error.code


def test_a_catalogue_takes_existing_directories(tmp_path):
    with pytest.raises(RequestError, match="no directory"):
        MeshCatalogue([tmp_path / "gone"])
    with pytest.raises(RequestError, match="at least one"):
        MeshCatalogue([])


def test_a_plain_file(directory, write, mesh_path):
    part = load_part(directory / "box.stl")
    assert part.mesh_id == "box"
    assert part.notes == ()
    with pytest.raises(MeshError) as caught:
        load_part(directory / "box.stl", "m")
    assert caught.value.code == ErrorCode.MESH_EXTENT_IMPLAUSIBLE
    asked = load_part(mesh_path(write.obj(*write.box_arrays()), "b.obj"), "m")
    assert not any("default unit" in n for n in asked.notes)


def test_a_step_file_says_that_its_own_unit_counts(write, mesh_path):
    part = load_part(mesh_path(write.step_box((60, 50, 40)), "box.step"), "m")
    np.testing.assert_allclose(part.mesh.extent, write.box_size, rtol=1e-6)
    assert any("names its own" in n for n in part.notes)


def test_a_plain_file_is_what_others_can_show(tmp_path):
    for name in ("plain.stl", "scaled.obj", "other.ply", "body.stl"):
        (tmp_path / name).write_bytes(b"")  # it is not read
    (tmp_path / "scaled.yaml").write_text("unit: inch\nscale: 2.0\n")
    (tmp_path / "body.yaml").write_text("body: 1\n")
    catalogue = MeshCatalogue([tmp_path], CatalogueSettings(default_unit="mm"))
    assert catalogue.plain_file("plain") == (tmp_path / "plain.stl", 1e-3)
    assert catalogue.plain_file("scaled") == (tmp_path / "scaled.obj", 0.0508)
    assert catalogue.plain_file("other") is None  # might be a cloud
    assert catalogue.plain_file("body") is None
    with pytest.raises(RequestError, match="unknown"):
        catalogue.plain_file("gear")


@pytest.mark.parametrize(
    ("size", "unit", "advice"),
    [
        (2.8, "m", "centimetres or inches: give the unit (--unit cm or inch"),
        (2.8, "mm", "centimetres or inches"),
        (90.0, "m", "probably in millimetres"),
        (0.09, "mm", "probably in metres"),
        (45.0, "in", "probably in millimetres"),
    ],
)
def test_a_size_that_cannot_be_names_the_units_that_could(tmp_path, write, size, unit, advice):
    vertices, faces = write.box_arrays(np.full(3, size))
    (tmp_path / "part.stl").write_bytes(write.binary_stl(vertices, faces))
    with pytest.raises(MeshError) as caught:
        load_part(tmp_path / "part.stl", unit)
    assert caught.value.code == ErrorCode.MESH_EXTENT_IMPLAUSIBLE
    assert advice in caught.value.message


def test_a_unit_by_its_other_name_is_no_contradiction(tmp_path, write):
    vertices, faces = write.box_arrays(np.full(3, 2.0))
    (tmp_path / "part.stl").write_bytes(write.binary_stl(vertices, faces))
    (tmp_path / "part.yaml").write_text("unit: inch\n")
    assert not any("as asked" in note for note in load_part(tmp_path / "part.stl", "in").notes)
    assert any("as asked" in note for note in load_part(tmp_path / "part.stl", "cm").notes)
