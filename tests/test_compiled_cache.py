"""The folder of compiled functions follows the sources."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gpis_grasp_planner
from gpis_grasp_planner import compiled_cache

PACKAGE = Path(gpis_grasp_planner.__file__).parent


def folders_of(root: Path, **variables: str) -> list[Path]:
    """Folders that a process chooses which imports the package under `root`."""
    env = {k: v for k, v in os.environ.items() if k not in {"NUMBA_CACHE_DIR", "XDG_CACHE_HOME"}}
    code = "from gpis_grasp_planner.compiled_cache import folders; print(*folders(), sep='\\n')"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**env, "PYTHONPATH": str(root), **variables},
        capture_output=True,
        text=True,
        check=True,
    )
    return [Path(line) for line in done.stdout.split()]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    copy = tmp_path / "gpis_grasp_planner"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__", "*.stl"))
    return copy


@pytest.mark.parametrize("module", ["geometry/gjk.py", "surface/kernels.py", "compiled.py"])
def test_an_edit_of_any_compiled_module_gives_another_folder(copy: Path, module: str) -> None:
    before = folders_of(copy.parent)
    assert before[0] == copy / "__pycache__" / f"compiled-{compiled_cache.sources_hash()}"
    assert folders_of(copy.parent) == before
    with (copy / module).open("a") as file:
        file.write("\n# edited\n")
    assert not set(folders_of(copy.parent)) & set(before)


def test_a_module_without_compiled_code_does_not_matter(copy: Path) -> None:
    before = folders_of(copy.parent)
    with (copy / "errors.py").open("a") as file:
        file.write("\n# edited\n")
    assert folders_of(copy.parent) == before


def test_the_environment_decides_where_it_says_so(tmp_path: Path) -> None:
    [folder] = folders_of(PACKAGE.parent, NUMBA_CACHE_DIR=str(tmp_path))
    assert folder.parent == tmp_path


def test_the_users_cache_comes_second(tmp_path: Path) -> None:
    beside, own = folders_of(PACKAGE.parent, XDG_CACHE_HOME=str(tmp_path))
    assert beside.parent == PACKAGE / "__pycache__"
    assert own.parent == tmp_path / "gpis_grasp_planner"


def test_a_user_without_a_home_has_no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setattr(Path, "home", no_home)
    assert compiled_cache.user_cache() is None
    assert len(compiled_cache.folders()) == 1


def test_folders_of_earlier_states_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled_cache, "_roots", lambda: [tmp_path])
    names = ["numba-0123", "compiled-0123", f"compiled-{compiled_cache.sources_hash()}", "objects"]
    for name in names:
        (tmp_path / name).mkdir()
    compiled_cache.remove_stale_caches()
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names[2:])
