"""One version everywhere: files that cannot read it say the same."""

from __future__ import annotations

import re
import tomllib
import xml.etree.ElementTree as ET
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml

from gpis_grasp_planner import __version__

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize("package", ["gpis_grasp_planner", "gpis_grasp_msgs"])
def test_the_ros_packages(package: str) -> None:
    tree = ET.parse(ROOT / "ros2_ws/src" / package / "package.xml")
    assert tree.findtext("version") == __version__


def test_the_benchmark_and_the_citation() -> None:
    project = tomllib.loads((ROOT / "benchmark/pyproject.toml").read_text())["project"]
    assert project["version"] == __version__
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == __version__


def test_what_is_installed() -> None:
    assert version("gpis_grasp_planner") == __version__


def test_the_changelog_has_the_version_and_its_day_first() -> None:
    text = (ROOT / "CHANGELOG.md").read_text()
    titles = re.findall(r"^## \[(.+?)\](?: - (\d{4}-\d{2}-\d{2}))?$", text, flags=re.MULTILINE)
    assert titles[0] == ("Unreleased", "")
    released, day = titles[1]
    assert released == __version__
    assert day == str(yaml.safe_load((ROOT / "CITATION.cff").read_text())["date-released"])
