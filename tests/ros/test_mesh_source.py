"""A fingerprint changes with whatever may change the meaning of a mesh ID."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from gpis_grasp_planner.ros.mesh_source import fingerprint

LIMIT = 10_000


def test_a_mesh_in_a_subdirectory_has_a_fingerprint_of_its_own(tmp_path: Path) -> None:
    (tmp_path / "gearbox").mkdir()
    (tmp_path / "gearbox" / "planet.step").write_bytes(b"mesh")
    (tmp_path / "planet.step").write_bytes(b"another")
    before = fingerprint([tmp_path], "gearbox/planet", LIMIT)
    assert before is not None
    assert before != fingerprint([tmp_path], "planet", LIMIT)
    (tmp_path / "planet.step").write_bytes(b"changed")
    assert fingerprint([tmp_path], "gearbox/planet", LIMIT) == before
    (tmp_path / "gearbox" / "planet.yaml").write_text("unit: mm")
    assert fingerprint([tmp_path], "gearbox/planet", LIMIT) != before


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "mug.stl").write_bytes(b"mesh")
    (tmp_path / "mug.yaml").write_text("unit: m\n")
    (tmp_path / "muggy.stl").write_bytes(b"other")
    return tmp_path


def test_it_is_the_same_while_nothing_changes(folder: Path) -> None:
    before = fingerprint([folder], "mug", LIMIT)
    os.utime(folder / "mug.stl")
    (folder / "muggy.stl").write_bytes(b"changed")
    assert fingerprint([folder], "mug", LIMIT) == before
    assert before is not None


@pytest.mark.parametrize("mesh_id", ["mug", "mug.stl"])
@pytest.mark.parametrize("name", ["mug.stl", "mug.yaml", "mug.stl.yaml", "mug.obj"])
def test_it_changes_with_mesh_and_sidecar_and_rivals(folder: Path, mesh_id: str, name: str) -> None:
    before = fingerprint([folder], mesh_id, LIMIT)
    (folder / name).write_bytes(b"MESH")
    assert fingerprint([folder], mesh_id, LIMIT) != before


@pytest.mark.parametrize("name", ["mug.stl", "mug.yaml"])
def test_it_changes_when_a_file_goes(folder: Path, name: str) -> None:
    before = fingerprint([folder], "mug", LIMIT)
    (folder / name).unlink()
    assert fingerprint([folder], "mug", LIMIT) not in (before, None)


def test_an_earlier_directory_counts(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    first = tmp_path_factory.mktemp("first")
    before = fingerprint([first, folder], "mug", LIMIT)
    (first / "mug.ply").write_bytes(b"ply")
    assert fingerprint([first, folder], "mug", LIMIT) != before


def test_a_change_that_keeps_size_and_time_of_writing_is_seen(folder: Path) -> None:
    """Also of a file that has lain there for long, whose content is known."""
    path = folder / "mug.stl"
    with pytest.MonkeyPatch.context() as patched:
        later_ns = time.time_ns() + 10**10
        patched.setattr(time, "time_ns", lambda: later_ns)
        before = fingerprint([folder], "mug", LIMIT)
        status = path.stat()
        path.write_bytes(b"MESH")
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
        assert fingerprint([folder], "mug", LIMIT) != before


def test_a_file_that_was_just_written_is_read_again(folder: Path) -> None:
    """Two writes within a tick of the file system's clock have the same times."""
    path = folder / "mug.stl"
    fingerprints = set()
    for k in range(200):
        path.write_bytes(b"%04d" % k)
        fingerprints.add(fingerprint([folder], "mug", LIMIT))
    assert len(fingerprints) == 200


def test_an_unknown_id_has_none(folder: Path) -> None:
    assert fingerprint([folder, folder / "missing"], "cup", LIMIT) is None


def test_a_pipe_does_not_block_and_a_large_file_is_not_read(folder: Path) -> None:
    os.mkfifo(folder / "pipe.stl")
    assert fingerprint([folder], "pipe", LIMIT) is not None
    large = folder / "large.stl"
    large.write_bytes(b"x" * (LIMIT + 1))
    before = fingerprint([folder], "large", LIMIT)
    os.utime(large, ns=(0, 0))
    assert fingerprint([folder], "large", LIMIT) != before
