"""Compiled functions on disk, and disks that do not do as they should."""

from __future__ import annotations

import errno
import logging
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpis_grasp_planner
from gpis_grasp_planner import compiled, compiled_cache
from gpis_grasp_planner.compiled import FunctionFiles, is_ready, mark_ready, njit, when_compiling


def twice(x):
    return 2 * x


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the only folder of this test's compiled code."""
    use(monkeypatch, tmp_path / "compiled")
    return tmp_path / "compiled"


def use(monkeypatch: pytest.MonkeyPatch, *folders: Path) -> None:
    monkeypatch.setattr(compiled, "folders", lambda: folders)
    monkeypatch.setattr(compiled_cache, "folders", lambda: folders)
    monkeypatch.setattr(FunctionFiles, "_said", False)


def loaded_from_disk(function: Any) -> bool:
    return bool(sum(function.stats.cache_hits.values()))


def test_what_one_process_compiled_another_loads(folder: Path) -> None:
    first = njit(twice)
    assert first(3) == 6
    assert not loaded_from_disk(first)
    second = njit(twice)
    assert second(4) == 8
    assert loaded_from_disk(second)


def test_signatures_and_functions_have_files_of_their_own(folder: Path) -> None:
    # Both are compiled before either has seen the other's file, as by two processes at a time.
    one, other = njit(twice), njit(twice)
    assert one(3) == 6
    assert other(1.25) == 2.5
    assert len(list(folder.iterdir())) == 2
    third = njit(twice)
    assert third(1.5) == 3.0
    assert isinstance(third(5), int)
    assert sum(third.stats.cache_hits.values()) == 2


@pytest.mark.parametrize("where", [0, 40, -1])
def test_a_damaged_file_is_compiled_anew(folder: Path, where: int) -> None:
    njit(twice)(3)
    [path] = folder.iterdir()
    content = bytearray(path.read_bytes())
    content[where] ^= 1
    path.write_bytes(content)
    again = njit(twice)
    assert again(3) == 6
    assert not loaded_from_disk(again)
    last = njit(twice)
    assert last(3) == 6
    assert loaded_from_disk(last)


def test_a_truncated_file_is_compiled_anew(folder: Path) -> None:
    njit(twice)(3)
    [path] = folder.iterdir()
    path.write_bytes(path.read_bytes()[:20])
    assert njit(twice)(3) == 6


def test_no_folder_at_all_costs_one_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    use(monkeypatch, tmp_path / "file" / "compiled")
    with caplog.at_level(logging.WARNING):
        assert njit(twice)(3) == 6
        assert njit(twice)(2.5) == 5.0
    assert [record.message.split(" (")[0] for record in caplog.records] == [
        "Compiled code cannot be kept"
    ]
    mark_ready("dual")
    assert not is_ready("dual")


def test_a_full_disk_costs_one_warning(
    folder: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(self: Path, content: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    assert njit(twice)(3) == 6
    assert njit(twice)(2.5) == 5.0
    assert len(caplog.records) == 1
    assert "No space left on device" in caplog.text
    assert not list(folder.iterdir())


def test_a_folder_that_can_only_be_read_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    image, own = tmp_path / "image", tmp_path / "own"
    use(monkeypatch, image, own)
    njit(twice)(3)
    mark_ready("dual")
    kept = sorted(image.iterdir())

    def read_only(path: Path, content: bytes) -> None:
        if path.parent == image:
            raise OSError(errno.EROFS, "Read-only file system")
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)

    monkeypatch.setattr(compiled_cache, "replace_file", read_only)
    function = njit(twice)
    assert function(3) == 6
    assert loaded_from_disk(function)
    assert is_ready("dual")
    assert function(2.5) == 5.0
    assert sorted(image.iterdir()) == kept
    assert len(list(own.iterdir())) == 1


def test_a_disk_with_room_for_the_mark_alone_is_not_ready(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = Path.write_bytes

    def nearly_full(self: Path, content: bytes) -> int:
        if len(content) > 1000:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(self, content)

    monkeypatch.setattr(Path, "write_bytes", nearly_full)
    assert njit(twice)(3) == 6
    mark_ready("dual")
    assert not is_ready("dual")


def test_ready_is_said_of_this_machine_only(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not is_ready("dual")
    mark_ready("dual")
    assert is_ready("dual")
    assert not is_ready("hpp")
    monkeypatch.setattr(compiled, "_machine", lambda: b"another processor")
    assert not is_ready("dual")


def test_the_listener_goes_with_its_block(folder: Path) -> None:
    heard: list[str] = []
    with when_compiling(lambda: heard.append("compiling")):
        pass
    njit(twice)(1)
    assert heard == []


def test_loading_is_not_compiling(folder: Path) -> None:
    heard: list[str] = []
    with when_compiling(lambda: heard.append("compiling")):
        njit(twice)(1)
        assert heard == ["compiling"]
    with when_compiling(lambda: heard.append("again")):
        njit(twice)(1)
    assert heard == ["compiling"]


def test_options_of_numba_go_through(folder: Path) -> None:
    assert njit(inline="always")(twice).targetoptions["inline"] == "always"


def test_the_package_works_without_any_folder(tmp_path: Path) -> None:
    """An installation by another user, without a home: code is compiled in memory."""
    (tmp_path / "file").touch()
    program = """
import numpy as np
from gpis_grasp_planner.geometry import distance_field
counts = np.zeros((4, 4, 4), dtype=np.int32)
triangle = np.array([[[-1.0, -1.0, 1.5], [9.0, -1.0, 1.5], [-1.0, 9.0, 1.5]]])
distance_field._count_crossings(triangle, np.full(3, 0.1), 1.0, counts)
print(counts.sum(axis=(0, 1)).tolist())
"""
    run = subprocess.run(
        [sys.executable, "-c", program],
        env={
            **os.environ,
            "PYTHONPATH": str(Path(gpis_grasp_planner.__file__).parents[1]),
            "NUMBA_CACHE_DIR": str(tmp_path / "file" / "below"),
            "HOME": str(tmp_path / "file" / "home"),
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    counts = np.array(eval(run.stdout))
    assert counts[2] == 16
    assert counts.sum() == 16
    assert run.stderr.count("cannot be kept") == 1
