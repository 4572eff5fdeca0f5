"""The example of docs/extending.md, taken from the page as it is: its test runs, and it plans."""

from __future__ import annotations

import importlib
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import pytest

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.figures import ALWAYS
from gpis_grasp_planner.quality.measures import GROUP, MEASURES, make_measure
from gpis_grasp_planner.quality.settings import ObjectiveSettings

PAGE = (Path(__file__).resolve().parents[2] / "docs/extending.md").read_text(encoding="utf-8")
MODULE = "centroid_measure"


def blocks(language: str) -> list[str]:
    """The page's blocks of code in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The page's distribution as pip leaves it: its module, and its entry points beside it."""
    [project] = blocks("toml")
    declared = tomllib.loads(project)
    name, version = declared["project"]["name"], declared["project"]["version"]
    assert declared["tool"]["setuptools"]["py-modules"] == [MODULE]
    points = declared["project"]["entry-points"]
    (tmp_path / f"{MODULE}.py").write_text(blocks("python")[0])
    info = tmp_path / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(
        "\n".join(
            f"[{group}]\n" + "\n".join(f"{key} = {value}" for key, value in those.items())
            for group, those in points.items()
        )
    )
    assert list(points) == [GROUP]
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    yield importlib.import_module(MODULE)
    sys.modules.pop(MODULE, None)


def test_the_pages_own_test_passes(installed: ModuleType) -> None:
    _, test = blocks("python")
    names: dict[str, object] = {"__name__": "test_of_the_page"}
    exec(compile(test, "extending.md", "exec"), names)
    tests = [value for name, value in names.items() if name.startswith("test_")]
    assert tests
    for each in tests:
        each()


def test_its_measure_is_found_by_its_entry_point_and_plans(installed: ModuleType) -> None:
    assert make_measure("centroid_distance", ObjectiveSettings()) is installed.CENTROID
    part = MeshCatalogue([default_catalogue_directory()]).load("bracket")
    settings = PlannerSettings.from_mapping({"objective": {"name": "centroid_distance"}})
    request = PlanRequest(seed=3, n_grasps=5, max_evaluations=400, time_budget_s=300.0)
    result = GraspPlanner(settings).plan(part, request)
    assert len(result.grasps) >= 2
    for grasp in result.grasps:
        p = grasp.contacts.positions.mean(axis=0) - part.center_of_mass
        assert grasp.quality.measured["centroid_distance"] == pytest.approx((p @ p) ** 0.5)
    assert installed.CENTROID.figure in result.figures


def test_the_table_names_every_figure_of_ours() -> None:
    names = re.findall(r"^\| `(\w+)` \| (larger|smaller) \|", PAGE, flags=re.MULTILINE)
    ours = [*ALWAYS, *(make_measure(name, ObjectiveSettings()).figure for name in MEASURES)]
    expected = [(f.name, "larger" if f.larger_is_better else "smaller") for f in ours]
    assert names == expected
