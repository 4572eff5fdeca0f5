"""Programs that write the files that are generated and kept: no option is taken for a path."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "ros2_ws/src/gpis_grasp_planner/gpis_grasp_planner"
GENERATORS = (
    PACKAGE / "ros/parameter_file.py",
    PACKAGE / "ros/parameter_groups.py",
    PACKAGE / "hand/barrett_model.py",
    PACKAGE / "hand/models/four_finger_16/build_model.py",
    PACKAGE / "hand/models/three_finger_adaptive/build_model.py",
    ROOT / "scripts/draw_concepts.py",
)


@pytest.mark.parametrize("word", ["--help", "--unknown"])
@pytest.mark.parametrize("program", GENERATORS, ids=lambda path: path.parent.name + "/" + path.name)
def test_an_option_is_never_taken_for_a_file(program: Path, word: str, tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, program, word], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert run.returncode == (0 if word == "--help" else 2), run.stderr
    assert (run.stdout if word == "--help" else run.stderr).startswith("usage:")
    assert not list(tmp_path.iterdir())


def test_no_file_of_the_repository_has_an_options_name() -> None:
    assert not [path.name for path in ROOT.iterdir() if path.name.startswith("-")]
