"""Meshes read in a child: the same parts and errors, and a crash there is only an error here."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, MeshError, PlanningError, RequestError
from gpis_grasp_planner.geometry.catalogue import CatalogueSettings, MeshCatalogue
from gpis_grasp_planner.ros.worker import parts as part_loading
from gpis_grasp_planner.ros.worker.parts import PartLoader, load_apart

SETTINGS = CatalogueSettings()


def test_the_part_is_that_of_the_catalogue(parts: Path) -> None:
    part = load_apart([parts], SETTINGS, "mug")
    expected = MeshCatalogue([parts], SETTINGS).load("mug")
    assert part.mesh.content_hash == expected.mesh.content_hash
    np.testing.assert_array_equal(part.center_of_mass, expected.center_of_mass)
    facts = ("mesh_id", "mass", "volume", "watertight", "friction", "notes")
    assert [getattr(part, f) for f in facts] == [getattr(expected, f) for f in facts]


@pytest.mark.parametrize(
    ("mesh_id", "kind", "code"),
    [
        ("mugg", RequestError, ErrorCode.UNKNOWN_MESH),
        ("../mug", RequestError, ErrorCode.INVALID_MESH_ID),
        ("truncated", MeshError, ErrorCode.MESH_UNREADABLE),
        ("nan", MeshError, ErrorCode.MESH_NOT_FINITE),
    ],
)
def test_errors_keep_kind_code_and_message(
    parts: Path, mesh_id: str, kind: type, code: ErrorCode
) -> None:
    with pytest.raises(kind) as here:
        MeshCatalogue([parts], SETTINGS).load(mesh_id)
    with pytest.raises(kind) as apart:
        PartLoader().load([parts], SETTINGS, mesh_id)
    assert apart.value.code == here.value.code == code
    assert apart.value.message == here.value.message


def test_a_crash_while_reading_is_an_error_of_the_mesh(
    parts: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def crash(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGSEGV)

    monkeypatch.setattr(MeshCatalogue, "load", crash)
    with pytest.raises(MeshError, match="Reading the mesh 'mug' ended") as caught:
        load_apart([parts], SETTINGS, "mug")
    assert caught.value.code == ErrorCode.MESH_UNREADABLE
    assert multiprocessing.active_children() == []


@pytest.fixture
def stuck(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reading a mesh takes for ever."""
    monkeypatch.setattr(MeshCatalogue, "load", lambda *_: signal.pause())


@pytest.mark.usefixtures("stuck")
def test_a_reader_that_hangs_is_ended_at_its_limit(parts: Path) -> None:
    with pytest.raises(MeshError, match=r"not done after 0\.2 s .*mesh_read_limit_s") as caught:
        load_apart([parts], SETTINGS, "mug", limit_s=0.2)
    assert caught.value.code == ErrorCode.MESH_UNREADABLE
    assert multiprocessing.active_children() == []


@pytest.mark.usefixtures("stuck")
def test_a_reader_that_nobody_waits_for_is_ended(parts: Path) -> None:
    with pytest.raises(PlanningError, match="Cancelled while the mesh 'mug'") as caught:
        PartLoader().load([parts], SETTINGS, "mug", should_stop=lambda: True)
    assert caught.value.code == ErrorCode.CANCELLED
    assert multiprocessing.active_children() == []


def test_a_directory_that_is_gone_is_named_by_number_not_by_path(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match=r"Directory 1 of 1 .*mesh_directories") as caught:
        load_apart([tmp_path / "gone"], SETTINGS, "mug")
    assert str(tmp_path) not in caught.value.message


def test_a_part_is_kept_until_its_file_or_the_settings_change(
    parts: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []

    def counted(_directories: object, _settings: object, mesh_id: str, *_: object) -> object:
        read.append(mesh_id)
        return MeshCatalogue([tmp_path], SETTINGS).load(mesh_id)

    monkeypatch.setattr(part_loading, "load_apart", counted)
    for name in ("mug", *"abcd"):
        shutil.copy(parts / "mug.stl", tmp_path / f"{name}.stl")
        (tmp_path / f"{name}.yaml").write_text("unit: mm")
    loader = PartLoader()
    first = loader.load([tmp_path], SETTINGS, "mug")
    assert loader.load([tmp_path], SETTINGS, "mug") is first
    assert read == ["mug"]
    loader.load([tmp_path], CatalogueSettings(max_faces=50_000), "mug")
    (tmp_path / "mug.yaml").write_text("unit: mm\nmass: 0.5")
    assert loader.load([tmp_path], SETTINGS, "mug").mass == 0.5
    assert read == ["mug"] * 3
    for name in ("a", "b", "c", "mug", "d", "mug", "a"):
        loader.load([tmp_path], SETTINGS, name)
    assert read == ["mug", "mug", "mug", "a", "b", "c", "d", "a"]


def test_neither_the_node_nor_reading_apart_loads_the_heavy_libraries(parts: Path) -> None:
    program = f"""
import sys
import gpis_grasp_planner.ros.node
print(*sorted({{"scipy", "numba", "pybullet", "trimesh"}} & set(sys.modules)))
from pathlib import Path
from gpis_grasp_planner.ros.worker.parts import CatalogueSettings, load_apart
load_apart([Path({str(parts)!r})], CatalogueSettings(), "mug")
print(*sorted({{"trimesh", "cascadio"}} & set(sys.modules)))
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines() == ["", ""]
