"""The folder of compiled functions follows the sources."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import gpis_grasp_planner
from gpis_grasp_planner.compiled_cache import sources_hash

PACKAGE = Path(gpis_grasp_planner.__file__).parent


def folder_of(root: Path) -> str:
    """Cache folder that a process chooses which imports the package under `root`."""
    env = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    code = "import gpis_grasp_planner, os; print(os.environ['NUMBA_CACHE_DIR'])"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**env, "PYTHONPATH": str(root)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.mark.parametrize("module", ["geometry/gjk.py", "surface/kernels.py"])
def test_an_edit_of_any_compiled_module_gives_another_folder(tmp_path: Path, module: str) -> None:
    copy = tmp_path / "gpis_grasp_planner"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__", "*.stl"))
    before = folder_of(tmp_path)
    assert Path(before).name == f"numba-{sources_hash()}"
    assert folder_of(tmp_path) == before
    with (copy / module).open("a") as file:
        file.write("\n# edited\n")
    assert folder_of(tmp_path) != before


def test_a_module_without_compiled_code_does_not_matter(tmp_path: Path) -> None:
    copy = tmp_path / "gpis_grasp_planner"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__", "*.stl"))
    before = folder_of(tmp_path)
    with (copy / "errors.py").open("a") as file:
        file.write("\n# edited\n")
    assert folder_of(tmp_path) == before


def test_the_environment_decides_where_it_says_so(tmp_path: Path) -> None:
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    code = "import gpis_grasp_planner, os; print(os.environ['NUMBA_CACHE_DIR'])"
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == str(tmp_path)
