from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_benchmark.runs import MOST_SECONDS, environment, execute, object_hash
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.plan.settings import PlannerSettings


@pytest.mark.parametrize(
    "change",
    [
        {"object_id": "flask"},
        {"object_hash": "1" * 16},
        {"planner": "random"},
        {"seed": 1},
        {"time_budget_s": 10.0},
        {"max_evaluations": 100},
        {"n_grasps": 10},
        {"friction": Friction(0.3, 0.3)},
        {"settings": {"hpp": {"batch": 5}}},
        {"version": "9.9.9"},
    ],
    ids=lambda change: next(iter(change)),
)
def test_each_thing_that_decides_a_run_is_in_its_key(make_run, change: dict) -> None:
    assert make_run(**change).key != make_run().key
    assert make_run().key == make_run().key


def test_equal_evaluations_do_not_depend_on_the_clock(make_run) -> None:
    one, other = (make_run(max_evaluations=64, time_budget_s=t) for t in (1.0, 30.0))
    assert one.key == other.key
    assert one.request().time_budget_s == MOST_SECONDS
    assert one.request().max_evaluations == 64
    assert make_run().request().time_budget_s == 20.0


def test_the_object_hash_is_that_of_mesh_and_centre_of_mass() -> None:
    part = MeshCatalogue([default_catalogue_directory()]).load("sphere")
    same = replace(part, mass=9.0, mesh_id="ball")
    moved = replace(part, center_of_mass=part.center_of_mass + np.array([1e-3, 0.0, 0.0]))
    assert object_hash(same) == object_hash(part) != object_hash(moved)


def test_a_run_gives_a_record_of_what_the_planner_answered(make_run) -> None:
    part = MeshCatalogue([default_catalogue_directory()]).load("bracket")
    run = make_run(
        object_id="bracket",
        object_hash=object_hash(part),
        planner="random-adaption",
        max_evaluations=128,
        time_budget_s=120.0,
        n_grasps=5,
        settings=PlannerSettings().as_dict(),
    )
    record, result = execute(run, part)
    assert record["key"] == run.key
    assert record["epsilon"] == [g.epsilon for g in result.grasps]
    assert record["volume"] == [g.volume for g in result.grasps]
    assert record["n_evaluations"] == result.evaluations >= 128
    assert 0.0 < record["cpu_s"] <= 1.2 * record["elapsed_s"]
    assert record["settings"] == PlannerSettings().as_dict()
    assert record["environment"] == environment()
    assert len(environment()["source"]) == 16
    again, _ = execute(run, part)
    assert again["epsilon"] == record["epsilon"]
    assert again["volume"] == record["volume"]
