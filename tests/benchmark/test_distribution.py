"""The benchmark's distribution: what it registers is there, and the planner lives without it."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import gpis_grasp_benchmark
from gpis_grasp_planner.search.searches import GROUP, registered

ROOT = Path(gpis_grasp_benchmark.__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_what_is_registered_is_what_is_installed() -> None:
    declared = PROJECT["entry-points"][GROUP]
    assert {name: point.value for name, point in registered().items()} == declared
    for name, value in declared.items():
        assert callable(EntryPoint(name, value, GROUP).load())


def test_the_command_is_there() -> None:
    [value] = PROJECT["scripts"].values()
    assert callable(EntryPoint("command", value, "console_scripts").load())


def test_the_planner_knows_its_own_searches_without_it() -> None:
    """In a process that cannot import it, and without a look at any entry point."""
    program = """
import importlib.metadata, sys
sys.modules["gpis_grasp_benchmark"] = None
def none(**_): raise AssertionError("entry points were asked for")
importlib.metadata.entry_points = none
from gpis_grasp_planner.search import searches
print(*map(searches.check_planner, searches.PLANNERS))
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == ["dual", "hpp", "paper", "random", "random-adaption"]
