"""docs/algorithm.md and docs/notation.md name code and settings that exist."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

from gpis_grasp_planner.plan.settings import setting_groups
from gpis_grasp_planner.search.searches import PLANNERS
from gpis_grasp_planner.settings import describe

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE = (DOCS / "algorithm.md").read_text(encoding="utf-8")
NOTATION = (DOCS / "notation.md").read_text(encoding="utf-8")
SETTINGS = {f"{group}.{i.name}" for group, cls in setting_groups().items() for i in describe(cls)}
FOLDERS = "grasp|search|surroundings|plan|hand|quality|scene|optimise|surface|geometry"
NAMES = sorted(set(re.findall(rf"`((?:{FOLDERS})\.[A-Za-z_0-9.]+)`", PAGE)))


def resolve(name):
    """Import the longest module and walk the rest as attributes."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(["gpis_grasp_planner", *parts[:k]]))
        except ModuleNotFoundError:
            continue
        for part in parts[k:]:
            found = getattr(found, part)
        return found
    raise AttributeError(name)


@pytest.mark.parametrize("name", NAMES)
def test_named_code_exists(name):
    assert resolve(name) is not None


def test_the_page_names_much_of_the_code():
    assert len(NAMES) > 40


def test_named_settings_and_planners_exist():
    groups = "|".join(setting_groups())
    for text in (PAGE, NOTATION):
        named = set(re.findall(rf"`((?:{groups})\.[a-z_0-9]+)`", text))
        modules = {name for name in NAMES if name in named}
        assert named - modules
        assert named - modules <= SETTINGS
    assert set(re.findall(r'planner "([a-z-]+)"', PAGE)) <= set(PLANNERS)
