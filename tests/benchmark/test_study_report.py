"""Reports of records made up so that their shares are known."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gpis_grasp_benchmark.bullet_objects import Refusal
from gpis_grasp_benchmark.ranking_report import (
    BEST,
    EPSILON,
    TRIALS,
    orders,
    ranking_report,
    write_ranking_tables,
)
from gpis_grasp_benchmark.runs import Run
from gpis_grasp_benchmark.strict_tests import LIFT, NOISE, NOMINAL, TESTS
from gpis_grasp_benchmark.study_outcomes import (
    NOT_PLANNABLE,
    REFUSED,
    outcomes,
    write_tables,
)
from gpis_grasp_benchmark.study_report import study_report
from gpis_grasp_benchmark.study_runs import StudyRun

ENVIRONMENT = dict.fromkeys(("source", "cpu", "python", "numpy", "scipy", "numba"), "x")


def trial(test: str, cause: str = "", rank: int = 0, planner: str = "dual") -> dict[str, Any]:
    row = {
        "test": test, "planner": planner, "rank": rank, "held": not cause, "cause": cause,
        "friction": 0.6, "mass_kg": 0.1, "elapsed_s": 0.5, "slip_mm": 1.0, "turn_deg": 2.0,
    }  # fmt: skip
    return row if test == LIFT else row | {
        "penetration_mm": 0.4, "closing_slip_mm": 3.0, "closing_turn_deg": 4.0,
        "touching": ["bh_palm_link", "bh_finger_1_distal_link"],
    }  # fmt: skip


@pytest.fixture
def make_study(make_run: Callable[..., Run]) -> Callable[..., dict[str, Any]]:
    """Maker of records by the trials of the first planner's and the second planner's grasps."""

    def make(object_id: str, trials: list[dict[str, Any]], object_set: str = "parts") -> dict:
        run = StudyRun(make_run(object_id=object_id, planner="dual"), object_set)
        grasps = 2 if any(row["planner"] == "dual" for row in trials) else 0
        plan = {
            "planner": "dual", "status": "SUCCESS", "message": "as found", "elapsed_s": 5.0,
            "cpu_s": 5.0, "evaluations": 100, "epsilon": [0.1] * grasps,
            "said_to_hold": [True, None][:grasps],
        }  # fmt: skip
        return {
            "key": run.key, **run.identity(), "settings": run.plan.settings,
            "extent_m": [0.1, 0.05, 0.05], "faces": 12, "watertight": True, "volume_m3": 1e-4,
            "cad_mass_kg": 0.1, "notes": [], "plans": [plan], "cover_s": 1.0, "trials": trials,
            "environment": ENVIRONMENT,
        }  # fmt: skip

    return make


@pytest.fixture
def records(make_study: Callable[..., dict[str, Any]]) -> list[dict[str, Any]]:
    every = [trial(test) for test in TESTS if test != NOISE]
    good = make_study("good", [*every, trial(NOISE), trial(NOISE), trial(NOISE, "slipped")])
    second = make_study(
        "second",
        [
            *(trial(t, "slipped") for t in TESTS if t != NOISE),
            *(trial(NOISE, c) for c in ("collision", "slipped", "slipped", "")),
            trial(NOMINAL, rank=1),
        ],
        "others",
    )
    nothing = make_study("nothing", [trial(NOMINAL, planner="eigengrasp-two-level")])
    return [good, second, nothing]


REFUSALS = [Refusal("lego", "others", "lego.obj: a face has no area.")]


def test_verdicts_and_causes(records: list[dict[str, Any]]) -> None:
    good, second, nothing, lego = outcomes(records, REFUSALS)
    assert all(verdict.held for verdict in good.verdicts.values())
    assert good.verdicts[NOISE].share == pytest.approx(2 / 3)
    assert second.graspable
    assert second.verdicts[NOISE].cause == "slipped"
    assert (second.verdicts[NOISE].held, second.verdicts[NOISE].share) == (False, 0.25)
    assert nothing.graspable  # by the second planner
    assert {v.cause for v in nothing.verdicts.values()} == {NOT_PLANNABLE}
    assert (lego.graspable, lego.verdicts[NOMINAL].cause) == (False, REFUSED)


def test_the_report_counts_every_object(records: list[dict[str, Any]]) -> None:
    text = study_report(records, REFUSALS, "gpis-grasp-benchmark", missing=["late"])
    graspable, everything = text.split("## Of all objects")
    assert "| all | 3 | 1/3 = 33.3 %" in graspable
    assert "| all | 4 | 1/4 = 25.0 %" in everything
    assert "| others | 2 | 0/2 = 0.0 %" in everything
    assert "| nominal | slipped | 1 | second |" in text
    assert "| nominal | refused mesh | 1 | *lego* |" in text
    assert "| lego | others | lego.obj: a face has no area. |" in text
    assert "**Not finished, and in none of the shares**: late." in text
    assert "had tried 2 itself; the verdicts agree on 1/2" in text
    assert "0.40 mm" in text
    assert (
        "| second | slipped | 0.100 | palm, finger 1 distal | 3.0 mm, 4 deg | 1.0 mm, 2 deg "
        "| holds | 1 of 2 |  |" in text
    )


def test_the_tables_hold_every_object_and_trial(
    records: list[dict[str, Any]], tmp_path: Path
) -> None:
    write_tables(tmp_path, records, REFUSALS)
    with (tmp_path / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["object_id"] for row in rows] == ["good", "second", "nothing", "lego"]
    assert [row[NOMINAL] for row in rows] == ["1", "0", "0", "0"]
    assert rows[1][f"{NOISE}: cause"] == "slipped"
    values = json.loads((tmp_path / "results.json").read_text())
    assert values["records"] == records
    assert values["refused"][0]["object_id"] == "lego"


def ranked(make_run: Callable[..., Run], object_id: str, shares: list[int]) -> dict[str, Any]:
    """Grasps in the order of epsilon that hold `shares` of ten displacements; the model knows."""
    return {
        **make_run(object_id=object_id, planner="dual").identity(),
        "object_set": "parts", "tried": len(shares), "displacements": 10, "selecting": 2,
        "settings": make_run().settings, "environment": ENVIRONMENT,
        "grasps": [
            {
                "epsilon": 0.3 - 0.1 * rank, "volume": 0.1, "held": True, "cause": "",
                "probability": {"as set": 0.1 * share}, "quality": {"as set": 0.1},
                "trials": [k < share for k in range(10)], "selecting": [share > 5, share > 2],
                "trials: elapsed_s": [0.5] * 10,
            }
            for rank, share in enumerate(shares)
        ],
    }  # fmt: skip


def test_orders_and_what_they_gain(make_run: Callable[..., Run], tmp_path: Path) -> None:
    records = [ranked(make_run, "a", [2, 9, 4]), ranked(make_run, "b", [8, 3, 6])]
    assert orders(records[0]) == {
        EPSILON: [0, 1, 2],
        "probability: as set": [1, 2, 0],
        "nominal trial, then epsilon and volume": [0, 1, 2],
        TRIALS: [1, 2, 0],
        BEST: [1, 2, 0],
    }
    text = ranking_report([*records, ranked(make_run, "none", [])], "gpis-grasp-benchmark")
    assert "**Without a grasp, and not counted**: none." in text
    assert "| epsilon and volume | 50.0 % [20.0, 80.0] |" in text
    assert "| probability: as set | 85.0 % [80.0, 90.0] | 35.0 % [0.0, 70.0] |" in text
    assert "| as set | 1.00 (p 0) | 1.00 | +0.00 |" in text
    write_ranking_tables(tmp_path, records)
    with (tmp_path / "results.csv").open() as file:
        assert [row["share held"] for row in csv.DictReader(file)][:2] == ["0.200", "0.900"]
