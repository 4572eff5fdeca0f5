"""Shell completion: the shells' code, and what it answers."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from terminal_sessions import PROGRAM, environment

from gpis_grasp_planner.cli.completion import SHELLS, mesh_ids, setting_names
from gpis_grasp_planner.cli.main import COMMANDS
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory


def completed(line: str, tmp_path: Path) -> list[str]:
    """What the program answers to the shell for `line` with the cursor at its end."""
    file = tmp_path / "answer"
    subprocess.run(
        PROGRAM,
        env=environment(
            _ARGCOMPLETE="1",
            _ARGCOMPLETE_SHELL="bash",
            _ARGCOMPLETE_IFS="\n",
            _ARGCOMPLETE_STDOUT_FILENAME=str(file),
            _ARGCOMPLETE_SUPPRESS_SPACE="1",
            COMP_LINE=line,
            COMP_POINT=str(len(line)),
        ),
        check=True,
    )
    return file.read_text().splitlines()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("gpis-grasp pl", ["plan", "plan-all"]),
        ("gpis-grasp plan mu", ["mug"]),
        ("gpis-grasp plan mug --verify re", ["require"]),
        ("gpis-grasp plan mug --pic", ["--picture"]),
        ("gpis-grasp plan mug --set hpp.volume_w", ["hpp.volume_weight="]),
    ],
)
def test_words_are_completed(line: str, words: list[str], tmp_path: Path) -> None:
    assert completed(line, tmp_path) == words


def test_all_commands_meshes_and_settings_are_offered(tmp_path: Path) -> None:
    assert set(COMMANDS) <= set(completed("gpis-grasp ", tmp_path))
    from argparse import Namespace

    assert mesh_ids(Namespace()) == MeshCatalogue([default_catalogue_directory()]).ids()
    assert "verification.mass_kg=" in setting_names()


@pytest.mark.parametrize("shell", SHELLS)
def test_the_code_is_of_that_shell(gpis_grasp, shell: str, tmp_path: Path) -> None:
    code = gpis_grasp("completion", shell).out
    assert "gpis-grasp" in code
    program = shutil.which(shell)
    if program is not None:  # read, not run: a syntax error would show
        file = tmp_path / f"code.{shell}"
        file.write_text(code)
        subprocess.run([program, "-n", str(file)], check=True)


def test_as_json(gpis_grasp) -> None:
    said = json.loads(gpis_grasp("completion", "fish", "--json").out)
    assert said["shell"] == "fish"
    assert said["code"] + "\n" == gpis_grasp("completion", "fish").out


def test_bash_completes_with_it(tmp_path: Path) -> None:
    """In a real bash, with the command on its path."""
    program = tmp_path / "gpis-grasp"
    program.write_text(
        f"#!{sys.executable}\n"
        "from gpis_grasp_planner.cli.main import main\n"
        "raise SystemExit(main())\n"
    )
    program.chmod(0o755)
    script = (
        'eval "$(gpis-grasp completion bash)"\n'
        'COMP_WORDS=(gpis-grasp plan mu) COMP_CWORD=2 COMP_LINE="gpis-grasp plan mu"\n'
        "COMP_POINT=18 COMP_TYPE=9\n"
        "_python_argcomplete gpis-grasp\n"
        'printf "%s\\n" "${COMPREPLY[@]}"\n'
    )
    done = subprocess.run(
        ["bash", "--norc", "-c", script],
        env=environment(PATH=f"{tmp_path}:{os.environ['PATH']}"),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == ["mug"]
