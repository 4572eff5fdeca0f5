"""The examples of docs/extending.md, taken from the page as they are: tests run, and they plan."""

from __future__ import annotations

import importlib
import re
import sys
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.grasp.funnel import Step
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.figures import ALWAYS
from gpis_grasp_planner.quality.measures import MEASURES, make_measure
from gpis_grasp_planner.quality.settings import ObjectiveSettings
from gpis_grasp_planner.surroundings.place import Place

PAGE = (Path(__file__).resolve().parents[2] / "docs/extending.md").read_text(encoding="utf-8")
MEASURE, CONSTRAINT = "centroid_measure", "cable_rule"


def blocks(language: str) -> list[str]:
    """The page's blocks of code in a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, flags=re.MULTILINE | re.DOTALL)


def installed(module: str, folder: Path) -> ModuleType:
    """A distribution of the page as pip leaves it: its module, and its entry points beside it."""
    [project] = [text for text in blocks("toml") if f'"{module}"' in text]
    declared = tomllib.loads(project)
    name, version = declared["project"]["name"], declared["project"]["version"]
    assert declared["tool"]["setuptools"]["py-modules"] == [module]
    points = declared["project"]["entry-points"]
    [source] = [t for t, after in pairwise(blocks("python")) if f"from {module} import" in after]
    (folder / f"{module}.py").write_text(source)
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(
        "\n".join(
            f"[{group}]\n" + "\n".join(f"{key} = {value}" for key, value in those.items())
            for group, those in points.items()
        )
    )
    importlib.invalidate_caches()
    return importlib.import_module(module)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where the page's distributions are installed."""
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for module in (MEASURE, CONSTRAINT):
        sys.modules.pop(module, None)


@pytest.mark.parametrize("module", [MEASURE, CONSTRAINT])
def test_the_pages_own_test_passes(folder: Path, module: str) -> None:
    installed(module, folder)
    [test] = [text for text in blocks("python") if f"from {module} import" in text]
    names: dict[str, object] = {"__name__": "test_of_the_page"}
    exec(compile(test, "extending.md", "exec"), names)
    tests = [value for name, value in names.items() if name.startswith("test_")]
    assert tests
    for each in tests:
        each()


def test_its_measure_is_found_by_its_entry_point_and_plans(folder: Path) -> None:
    measure = installed(MEASURE, folder).CENTROID
    assert make_measure("centroid_distance", ObjectiveSettings()) is measure
    assert make_measure(f"{MEASURE}:CENTROID", ObjectiveSettings()) is measure
    part = MeshCatalogue([default_catalogue_directory()]).load("bracket")
    settings = PlannerSettings.from_mapping({"objective": {"name": "centroid_distance"}})
    request = PlanRequest(seed=3, n_grasps=5, max_evaluations=400, time_budget_s=300.0)
    result = GraspPlanner(settings).plan(part, request)
    assert len(result.grasps) >= 2
    for grasp in result.grasps:
        p = grasp.contacts.positions.mean(axis=0) - part.center_of_mass
        assert grasp.quality.measured["centroid_distance"] == pytest.approx((p @ p) ** 0.5)
    assert measure.figure in result.figures


def test_its_constraint_is_found_by_its_entry_point_and_respected(folder: Path) -> None:
    rule = installed(CONSTRAINT, folder)
    part = MeshCatalogue([default_catalogue_directory()]).load("bracket")
    settings = PlannerSettings.from_mapping({"constraints": {"names": ["cable"]}})
    request = PlanRequest(seed=3, n_grasps=10, max_evaluations=600, time_budget_s=300.0)
    # The part is turned: its -x is up.
    T_world_object = np.eye(4)
    T_world_object[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    answer = GraspPlanner(settings).answer(part, request, Place(T_world_object))
    y_up = [(T_world_object @ g.T_object_palm)[2, 1] for g in answer.result.grasps]
    assert len(y_up) >= 2
    assert min(y_up) >= rule.LOWEST - 1e-9
    assert answer.result.funnel.causes(Step.PALM_FREE)["cable"] > 0


def test_the_table_names_every_figure_of_ours() -> None:
    names = re.findall(r"^\| `(\w+)` \| (larger|smaller) \|", PAGE, flags=re.MULTILINE)
    ours = [*ALWAYS, *(make_measure(name, ObjectiveSettings()).figure for name in MEASURES)]
    expected = [(f.name, "larger" if f.larger_is_better else "smaller") for f in ours]
    assert names == expected
