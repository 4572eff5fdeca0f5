"""Subdirectories of a catalogue, files that no ID can name, and what a sidecar chooses."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import mesh_dialects as d
import numpy as np
import pytest
import step_dialects
from hypothesis import given
from hypothesis import strategies as st
from mesh_dialects import BOX

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry import mesh_file
from gpis_grasp_planner.geometry.catalogue import ID_PATTERN, MeshCatalogue, load_part
from gpis_grasp_planner.geometry.catalogue_files import refused_files


@pytest.fixture
def directory(tmp_path: Path) -> Path:
    """`box.stl`, `gearbox/planet.stl` and `gearbox/stage-2/sun.obj`, in millimetres."""
    folder = tmp_path / "meshes"
    (folder / "gearbox" / "stage-2").mkdir(parents=True)
    for name, data in (
        ("box.stl", d.binary_stl(BOX)),
        ("gearbox/planet.stl", d.binary_stl(d.box((20, 20, 20)))),
        ("gearbox/stage-2/sun.obj", d.obj(d.box((30, 30, 30)))),
    ):
        (folder / name).write_bytes(data)
        (folder / name).with_suffix(".yaml").write_text("unit: mm\n")
    return folder


def refused(catalogue: MeshCatalogue, mesh_id: str) -> RequestError:
    with pytest.raises(RequestError) as caught:
        catalogue.load(mesh_id)
    return caught.value


def test_an_id_is_the_path_without_the_ending(directory):
    catalogue = MeshCatalogue([directory])
    assert catalogue.ids() == ["box", "gearbox/planet", "gearbox/stage-2/sun"]
    for mesh_id, size in (("gearbox/planet", 0.02), ("gearbox/stage-2/sun", 0.03)):
        part = catalogue.load(mesh_id)
        assert part.mesh_id == mesh_id
        np.testing.assert_allclose(part.mesh.extent, size, rtol=1e-6)
    full = catalogue.load("gearbox/planet.stl")
    assert full.mesh.content_hash == catalogue.load("gearbox/planet").mesh.content_hash
    assert catalogue.refused() == []


def test_stems_clash_within_a_folder_alone(directory):
    shutil.copy(directory / "box.stl", directory / "gearbox" / "box.stl")
    (directory / "gearbox" / "planet.obj").write_bytes(d.obj(BOX))
    catalogue = MeshCatalogue([directory])
    assert catalogue.ids() == [
        "box", "gearbox/box", "gearbox/planet.obj", "gearbox/planet.stl", "gearbox/stage-2/sun",
    ]  # fmt: skip
    error = refused(catalogue, "gearbox/planet")
    assert "gearbox/planet.obj, gearbox/planet.stl" in error.message


def test_an_unknown_id_names_those_in_folders(directory):
    error = refused(MeshCatalogue([directory]), "planet")
    assert error.code == ErrorCode.UNKNOWN_MESH
    assert "gearbox/planet" in error.message


def test_links_to_folders_are_not_followed(directory, tmp_path):
    outside = tmp_path / "outside"
    outside.mkdir()
    shutil.copy(directory / "box.stl", outside / "secret.stl")
    (directory / "linked").symlink_to(outside)
    (directory / "inner").symlink_to(directory / "gearbox")
    (directory / "loop").symlink_to(directory)
    catalogue = MeshCatalogue([directory])
    assert catalogue.ids() == ["box", "gearbox/planet", "gearbox/stage-2/sun"]
    for mesh_id in ("linked/secret", "inner/planet", "loop/box", "loop/loop/box"):
        assert refused(catalogue, mesh_id).code == ErrorCode.UNKNOWN_MESH


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("housing_lid A.1.stp", "has a blank; rename it, such as 'housing_lid_A.1.stp'"),
        ("geh\u00e4use.stl", "the character '\\xe4'; rename it, such as 'geh_use.stl'"),
        ("part(1).obj", "the character '('"),
        ("-part.stl", "does not start with a letter or digit; rename it, such as 'part.stl'"),
        ("a..b.stl", "two points in a row; rename it, such as 'a.b.stl'"),
        ("x" * 65 + ".ply", "65 characters"),
        ("my parts/lid.stl", "the folder's name has a blank; rename it, such as 'my_parts'"),
        ("gear.igs", "its format .igs is not read"),
    ],
)
def test_a_file_without_an_id_is_listed_with_its_reason(name, said, directory):
    path = directory / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(d.binary_stl(BOX))
    catalogue = MeshCatalogue([directory])
    [(listed, reason)] = catalogue.refused()
    assert listed == name
    assert said in reason
    assert catalogue.ids() == ["box", "gearbox/planet", "gearbox/stage-2/sun"]
    for asked in (name, name.rpartition(".")[0]):
        message = refused(catalogue, asked).message
        assert said.split(";")[0] in message, message
        assert message.isascii()
        assert len(message) < 500


def test_links_out_pipes_and_devices_are_listed(directory, tmp_path):
    (tmp_path / "outside.stl").write_bytes(d.binary_stl(BOX))
    (directory / "link.stl").symlink_to(tmp_path / "outside.stl")
    os.mkfifo(directory / "pipe.stl")
    names = dict(MeshCatalogue([directory]).refused())
    assert set(names) == {"link.stl", "pipe.stl"}
    assert all("no regular file inside" in reason for reason in names.values())


def test_what_is_no_mesh_is_not_listed(directory):
    for name in ("README.md", "box.mtl", ".hidden.stl", "Thumbs.db"):
        (directory / name).write_text("x")
    (directory / ".git").mkdir()
    (directory / ".git" / "a b.stl").write_bytes(d.binary_stl(BOX))
    assert MeshCatalogue([directory]).refused() == []


@given(
    st.text(
        st.characters(blacklist_characters="/\0", blacklist_categories=["Cs"]),
        min_size=1,
        max_size=30,
    )
)
def test_every_name_is_an_id_or_is_refused_with_a_name_that_is_one(tmp_path_factory, name):
    directory = tmp_path_factory.mktemp("names")
    if name.startswith(".") or len(f"{name}.stl".encode()) > 255:
        return
    (directory / f"{name}.stl").write_bytes(b"x")
    found = list(refused_files(directory))
    if MeshCatalogue([directory]).ids() == [name]:
        assert found == []
        return
    [(listed, reason)] = found
    assert listed == f"{name}.stl"
    better = reason.rpartition("such as '")[2].removesuffix("'")
    assert ID_PATTERN.fullmatch(better.removesuffix(".stl")), reason


def test_a_file_is_read_once(directory, monkeypatch):
    read: list[str] = []
    real = mesh_file.read_regular_file

    def counted(path: Path, max_bytes: int) -> bytes:
        read.append(path.name)
        return real(path, max_bytes)

    monkeypatch.setattr("gpis_grasp_planner.geometry.catalogue.read_regular_file", counted)
    MeshCatalogue([directory]).load("gearbox/planet")
    assert sorted(read) == ["planet.stl", "planet.yaml"]


def test_a_sidecar_chooses_a_body(directory):
    parts = [("bolt", d.box((20, 20, 20)), (0, 0, 0)), ("plate", d.box((80, 60, 5)), (0, 0, 30))]
    (directory / "whole.step").write_bytes(step_dialects.assembly(parts))
    catalogue = MeshCatalogue([directory])
    assert any("1 'bolt', 2 'plate'" in note for note in catalogue.load("whole").notes)
    for body in ("plate", "2"):
        (directory / "whole.yaml").write_text(f"body: {body}\n")
        np.testing.assert_allclose(
            catalogue.load("whole").mesh.extent, (0.08, 0.06, 0.005), rtol=1e-6
        )
    asked = load_part(directory / "whole.step", body="bolt")
    np.testing.assert_allclose(asked.mesh.extent, 0.02, rtol=1e-6)


@pytest.mark.parametrize(
    ("unit", "size"),
    [("m", 1.0), ("cm", 1e-2), ("mm", 1e-3), ("um", 1e-6), ("inch", 0.0254), ("in", 0.0254)],
)
def test_every_unit(unit, size, tmp_path):
    solid = d.Solid(BOX.vertices * 1e-3 / size, BOX.polygons, 0)
    (tmp_path / "part.obj").write_bytes(d.obj(solid))
    (tmp_path / "part.yaml").write_text(f"unit: {unit}\n")
    expected = (0.08, 0.06, 0.04)
    np.testing.assert_allclose(load_part(tmp_path / "part.obj").mesh.extent, expected, rtol=1e-9)
    (tmp_path / "part.yaml").unlink()
    part = load_part(tmp_path / "part.obj", unit)
    np.testing.assert_allclose(part.mesh.extent, expected, rtol=1e-9)
    assert not any("unit" in note for note in part.notes)


def test_a_scale_mends_a_glb_in_millimetres(tmp_path):
    (tmp_path / "part.glb").write_bytes(d.glb(*d.glb_document(BOX, scale=1.0)))
    with pytest.raises(Exception, match=r"'scale: 0\.001' in its YAML file"):
        load_part(tmp_path / "part.glb")
    (tmp_path / "part.yaml").write_text("scale: 0.001\n")
    part = load_part(tmp_path / "part.glb", "mm")
    np.testing.assert_allclose(part.mesh.extent, (0.08, 0.06, 0.04), rtol=1e-6)
    assert "Scaled by 0.001 as its YAML file says." in part.notes
    assert any("'mm' was not used: a GLB file names its own" in note for note in part.notes)


def test_the_cure_of_a_missing_unit_is_right_on_the_command_line_and_in_a_catalogue(tmp_path):
    (tmp_path / "part.obj").write_bytes(d.obj(BOX))
    with pytest.raises(Exception, match=r"\(--unit mm, or 'unit: mm' in its YAML file\)"):
        load_part(tmp_path / "part.obj")
