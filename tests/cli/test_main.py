from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from gpis_grasp_planner import __version__
from gpis_grasp_planner.cli import main as command
from gpis_grasp_planner.cli.exit_codes import MEANINGS
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


@pytest.mark.parametrize("name", sorted(set(command.COMMANDS) - {"worker"}))
def test_every_command_that_makes_something_speaks_json(gpis_grasp, name: str) -> None:
    assert "--json" in gpis_grasp(name, "--help").out


def test_version(gpis_grasp) -> None:
    assert gpis_grasp("--version").out == f"gpis-grasp {__version__}\n"


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("nonsense",),
        ("plan",),
        ("plan", "mug", "--seed", "x"),
        ("plan", "mug", "--unit", "furlong"),
    ],
)
def test_wrong_usage_is_2(gpis_grasp, arguments: tuple[str, ...]) -> None:
    answer = gpis_grasp(*arguments)
    assert answer.code == 2
    assert answer.out == ""
    [line] = answer.err.splitlines()
    assert line.startswith("gpis-grasp")
    assert line.endswith("--help' shows the usage.")


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (("plann", "mug"), "Did you mean plan?"),
        (("plan", "mug", "--tiem", "2", "--grasp", "3"), "Did you mean --time?"),
        (("plan", "mug", "--verify", "requir"), "Did you mean require?"),
        (("hand", "--urfd"), "Did you mean --urdf?"),
        (("completion", "tcsh"), "(choose from 'bash', 'zsh', 'fish')"),
    ],
)
def test_wrong_usage_says_what_was_meant(
    gpis_grasp, arguments: tuple[str, ...], meant: str
) -> None:
    answer = gpis_grasp(*arguments)
    assert answer.code == 2
    assert meant in answer.err
    assert f"gpis-grasp {arguments[0]}: error" in answer.err or arguments[0] == "plann"


def test_help_names_commands_codes_and_examples(gpis_grasp) -> None:
    text = gpis_grasp("--help").out
    assert max(map(len, text.splitlines())) < 80
    for name in command.COMMANDS:
        assert f"\n    {name}" in text
    for code, meaning in MEANINGS.items():
        assert f"\n  {code:<3} {meaning}" in text
    assert "examples:" in text


def test_help_loads_nothing_heavy() -> None:
    run = run_python(
        "import sys\n"
        "from gpis_grasp_planner.cli.main import main\n"
        "try:\n    main(['plan', '--help'])\nexcept SystemExit:\n    pass\n"
        "print(*sorted({'numpy', 'scipy', 'numba', 'rich', 'yaml', 'trimesh'} & set(sys.modules)))"
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.splitlines()[-1] == ""


@pytest.mark.parametrize("debug", [[], ["--debug"]])
def test_an_error_of_the_program_is_one_line_and_says_how_to_see_more(
    gpis_grasp, monkeypatch: pytest.MonkeyPatch, debug: list[str]
) -> None:
    def fail(arguments) -> int:
        raise KeyError("png\nno such key")

    monkeypatch.setattr(command.hand, "run", fail)
    answer = gpis_grasp("hand", *debug)
    assert answer.code == 1
    *trace, line = answer.err.splitlines()
    assert line.startswith("gpis-grasp: error: KeyError: 'png")
    assert "--debug" in line
    assert bool(trace) == bool(debug)
    assert gpis_grasp(*debug, "hand").err.count("Traceback") == len(debug)


@pytest.mark.parametrize(
    ("words", "loaded"),
    [
        ("hand --urdf", {"numpy", "yaml"}),
        ("hand --json", {"numpy", "yaml"}),
        ("settings --advanced", {"numpy"}),
        ("completion zsh", set()),
        ("plan nothere.step", {"numpy", "yaml"}),
        ("plan mug --set hpp.bunch=3", {"numpy", "yaml"}),
    ],
)
def test_commands_load_only_what_they_need(words: str, loaded: set[str]) -> None:
    run = run_python(
        "import contextlib, io, sys\n"
        "from gpis_grasp_planner.cli.main import main\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        f"    main({words.split()!r})\n"
        "heavy = {'numpy', 'scipy', 'numba', 'rich', 'yaml', 'trimesh', 'pybullet', 'matplotlib'}\n"
        "print(*sorted(heavy & set(sys.modules)))"
    )
    assert run.returncode == 0, run.stderr
    assert set(run.stdout.split()) <= loaded


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
