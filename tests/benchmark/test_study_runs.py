"""Real plans and trials of a box, with tiny budgets."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable

import pytest

from gpis_grasp_benchmark.ranking_runs import MODELS, RankingRun
from gpis_grasp_benchmark.runs import Run, object_hash
from gpis_grasp_benchmark.strict_tests import NOISE, NOMINAL, TESTS, volume_mass
from gpis_grasp_benchmark.study_runs import StudyRun
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.warm_up import box_part
from gpis_grasp_planner.verification.settings import VerificationSettings


@pytest.fixture(scope="module")
def part() -> Part:
    return box_part()


@pytest.fixture
def plan(make_run: Callable[..., Run], part: Part) -> Run:
    settings = PlannerSettings.from_mapping({"verification": {"duration_s": 0.3}})
    return make_run(
        object_id="box",
        object_hash=object_hash(part),
        planner="random-adaption",
        max_evaluations=64,
        time_budget_s=120.0,
        n_grasps=3,
        settings=settings.as_dict(),
    )


def test_the_first_grasp_gets_all_tests_and_the_others_the_nominal_one(
    plan: Run, part: Part
) -> None:
    run = StudyRun(plan, "boxes", tried=2, displacements=3)
    record, document = run.make(part)
    json.dumps(record, allow_nan=False)
    own = [row for row in record["trials"] if row["planner"] == "random-adaption"]
    assert Counter(row["test"] for row in own if row["rank"] == 0) == {
        test: 3 if test == NOISE else 1 for test in TESTS
    }
    assert [row["test"] for row in own if row["rank"] == 1] == [NOMINAL]
    assert all(row["held"] == (row["cause"] == "") for row in record["trials"])
    held = any(row["held"] for row in own if row["test"] == NOMINAL)
    assert len(record["plans"]) == (1 if held else 2)
    assert record["cad_mass_kg"] == pytest.approx(1000.0 * part.volume)
    assert record["plans"][0]["epsilon"] == [
        grasp["epsilon"] for grasp in json.loads(document)["grasps"]
    ]
    assert record["key"] == run.key
    for changed in (StudyRun(plan, "boxes", tried=3), StudyRun(plan, "others", tried=2)):
        assert changed.key != run.key


def test_every_grasp_of_a_ranking_is_tried_on_the_same_displacements(plan: Run, part: Part) -> None:
    record, _ = RankingRun(plan, "boxes", tried=2, displacements=2, selecting=1).make(part)
    json.dumps(record, allow_nan=False)
    assert len(record["grasps"]) == 2
    for grasp in record["grasps"]:
        assert (len(grasp["trials"]), len(grasp["selecting"])) == (2, 1)
        assert set(grasp["probability"]) == set(grasp["quality"]) == set(MODELS)
        assert all(0.0 <= p <= 1.0 for p in grasp["probability"].values())


def test_the_volumes_mass_is_the_usual_one_where_the_hand_cannot_carry_it(part: Part) -> None:
    assert volume_mass(part, VerificationSettings()) == pytest.approx(0.14)
    assert volume_mass(part, VerificationSettings(payload_kg=0.1)) == 0.1
