"""Every command of ours that README and docs print is one that its parser takes."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from gpis_grasp_benchmark.command import parser as benchmark_parser
from gpis_grasp_planner.cli.main import COMMANDS, parser

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def commands() -> list[tuple[str, str]]:
    """Page and command of each line of a code block that calls the program."""
    found = []
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        lines = re.findall(
            r"^(?: {4}|\$ )?(gpis-grasp(?:-benchmark)? [a-z-].*)$", text, flags=re.MULTILINE
        )
        found += [(page.name, line) for line in lines]
    return found


def test_there_are_some() -> None:
    assert len(commands()) > 10


@pytest.mark.parametrize(("page", "command"), commands())
def test_the_parser_takes_it(page: str, command: str) -> None:
    program, *words = shlex.split(command.partition("|")[0], comments=True)
    if "--help" in words:
        words.remove("--help")
    if program == "gpis-grasp-benchmark":
        benchmark_parser().parse_args(words)
        return
    arguments = parser().parse_args(words)  # SystemExit for what it does not take
    assert arguments.command == words[0], page


@pytest.mark.parametrize("name", COMMANDS)
def test_the_parser_takes_the_examples_of_a_commands_help(name: str) -> None:
    found = re.findall(r"gpis-grasp ([^\n|)]+?)(?: {2,}.*|[|)].*)?$", COMMANDS[name].EXAMPLES, re.M)
    assert any(line.split()[0] == name for line in found)
    for line in found:
        words = shlex.split(line.partition(" > ")[0])
        assert parser().parse_args(words).command == words[0]


def test_the_page_has_a_row_for_each_command_and_no_other() -> None:
    table = (ROOT / "docs/cli.md").read_text(encoding="utf-8").partition("| exit code |")[0]
    rows = re.findall(r"^\| `([a-z-]+)", table, flags=re.MULTILINE)
    assert sorted(rows) == sorted(COMMANDS)
