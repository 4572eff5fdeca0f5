from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gpis_grasp_planner import __version__
from gpis_grasp_planner.cli import main as command
from gpis_grasp_planner.errors import SystemFault

PACKAGE_ROOT = Path(command.__file__).parents[2]


def run_python(program: str, **pipes) -> subprocess.CompletedProcess:
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE_ROOT)}
    return subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        text=True,
        capture_output=True,
        check=False,
    )


@pytest.mark.parametrize("name", ["", *command.COMMANDS])
def test_help_of_every_command(gpis_grasp, name: str) -> None:
    answer = gpis_grasp(*name.split(), "--help")
    assert answer.code == 0
    assert "usage: gpis-grasp" in answer.out
    assert answer.err == ""


def test_version(gpis_grasp) -> None:
    assert gpis_grasp("--version").out == f"gpis-grasp {__version__}\n"


@pytest.mark.parametrize(
    "arguments",
    [(), ("nonsense",), ("plan",), ("plan", "mug", "--seed", "x"), ("plan", "mug", "--unit", "in")],
)
def test_wrong_usage_is_2(gpis_grasp, arguments: tuple[str, ...]) -> None:
    answer = gpis_grasp(*arguments)
    assert answer.code == 2
    assert "usage:" in answer.err


def test_help_loads_nothing_heavy() -> None:
    run = run_python(
        "import sys\n"
        "from gpis_grasp_planner.cli.main import main\n"
        "try:\n    main(['plan', '--help'])\nexcept SystemExit:\n    pass\n"
        "print(*sorted({'numpy', 'scipy', 'numba', 'rich', 'yaml', 'trimesh'} & set(sys.modules)))"
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines()[-1] == ""


@pytest.mark.parametrize(
    ("error", "code", "words"),
    [
        (SystemFault("The planet has stopped."), 1, "gpis-grasp: error: The planet has stopped."),
        (PermissionError(13, "Permission denied", "a.json"), 1, "a.json: Permission denied"),
        (KeyboardInterrupt(), 130, "interrupted"),
    ],
)
def test_errors_are_one_line(
    gpis_grasp, monkeypatch: pytest.MonkeyPatch, error: BaseException, code: int, words: str
) -> None:
    def fail(arguments) -> int:
        raise error

    monkeypatch.setattr(command.hand, "run", fail)
    answer = gpis_grasp("hand")
    assert answer.code == code
    assert words in answer.err
    assert len(answer.err.splitlines()) == 1
    assert "Traceback" not in answer.err


def test_a_closed_pipe_is_no_traceback() -> None:
    run = run_python(
        "import os, subprocess, sys\n"
        "call = [sys.executable, '-m', 'gpis_grasp_planner.cli.main', 'settings']\n"
        "reader, writer = os.pipe()\n"
        "os.close(reader)\n"
        "made = subprocess.run(call, stdout=writer, stderr=subprocess.PIPE, text=True)\n"
        "print(made.returncode)\n"
        "print(made.stderr)\n"
    )
    assert run.stdout.split() == ["1"], run.stdout
