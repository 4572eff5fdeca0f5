"""Constraints of users: found, made, respected by every grasp, and refused where they are wrong."""

from __future__ import annotations

import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from gpis_grasp_planner import registered
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.grasp.constraint import ClosedHands, Constraint, Verdict
from gpis_grasp_planner.grasp.constraint_settings import ConstraintSettings
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.own_constraints import (
    GROUP,
    OwnConstraint,
    Situation,
    identities,
    own_constraints,
)
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.store.conditions import Conditions
from gpis_grasp_planner.surroundings.place import Place

BAND_M = 0.03


class Band(Constraint):
    """All contacts within a band of heights about the centre of mass."""

    name = "band"

    def __init__(self, situation: Situation):
        self._z = situation.part.center_of_mass[2]

    def verdict(self, closed: ClosedHands) -> Verdict:
        verdict = Verdict.clear(len(closed))
        for row, n in enumerate(closed.n_contacts):
            if np.any(np.abs(closed.positions[row, :n, 2] - self._z) > BAND_M):
                verdict.cause[row] = self.name
        return verdict


class Never(Band):
    """Blocks everything."""

    name = "never"

    def verdict(self, closed: ClosedHands) -> Verdict:
        verdict = Verdict.clear(len(closed))
        verdict.cause[:] = "whatever it is"
        return verdict


@pytest.fixture(scope="module")
def part():
    return MeshCatalogue([default_catalogue_directory()]).load("mug")


@pytest.fixture
def offer(monkeypatch: pytest.MonkeyPatch):
    """Register a value as other distributions do, under the name 'mine'."""

    def register(value: object) -> None:
        module = ModuleType("strangers_constraints")
        module.value = value
        monkeypatch.setitem(sys.modules, "strangers_constraints", module)
        point = EntryPoint("mine", "strangers_constraints:value", GROUP)
        monkeypatch.setattr(
            registered, "entry_points", lambda group: [point] if group == GROUP else []
        )

    return register


def made(part, *names: str) -> tuple[Constraint, ...]:
    settings = ConstraintSettings(names=names)
    return own_constraints(load_hand("barrett_bh280"), part, Place(), settings)


def planned(part, *names: str):
    settings = PlannerSettings.from_mapping({"constraints": {"names": list(names)}})
    request = PlanRequest(seed=2, n_grasps=5, max_evaluations=600, time_budget_s=300.0)
    return GraspPlanner(settings).plan(part, request)


def test_every_grasp_of_an_answer_respects_it(part) -> None:
    result = planned(part, f"{__name__}:Band")
    assert result.grasps
    heights = np.concatenate([g.contacts.positions[:, 2] for g in result.grasps])
    assert np.abs(heights - part.center_of_mass[2]).max() <= BAND_M
    assert result.funnel.blocked["band"] > 0
    # The same search without it does come outside: the rule was not idle.
    free = np.concatenate([g.contacts.positions[:, 2] for g in planned(part).grasps])
    assert np.abs(free - part.center_of_mass[2]).max() > BAND_M


def test_its_cause_is_told_where_nothing_is_left(part) -> None:
    result = planned(part, f"{__name__}:Never")
    assert result.code.name == "ALL_GRASPS_BLOCKED"
    assert "whatever it is" in result.message


def test_an_entry_point_is_found_by_its_name(part, offer) -> None:
    offer(Band)
    [constraint] = made(part, "mine")
    assert constraint.name == "band"
    assert constraint.approach_axis is None
    T, joints = np.tile(np.eye(4), (3, 1, 1)), np.zeros((3, 8))
    assert constraint.allows(T, joints).all()
    assert constraint.allows_palm(T, joints).all()
    assert np.array_equal(constraint.nearest(T, joints), T)


def test_no_name_no_constraint(part) -> None:
    assert made(part) == ()


def test_an_unknown_name_lists_the_known(part, offer) -> None:
    offer(Band)
    with pytest.raises(RequestError, match=f"known are mine.*{GROUP}.*module:NAME"):
        made(part, "nonsense")


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("no_such_module_anywhere:X", "cannot be imported.*PYTHONPATH"),
        (f"{__name__}:NO_SUCH_OBJECT", "cannot be imported"),
        (f"{__name__}:BAND_M", "must be callable with a Situation"),
        (f"{__name__}:made", "cannot be made for 'mug'"),
        ("builtins:repr", "cannot be made"),
    ],
)
def test_what_makes_no_constraint_is_refused(part, name: str, match: str) -> None:
    with pytest.raises(RequestError, match=match):
        made(part, name)


@pytest.mark.parametrize(
    ("method", "answer", "match"),
    [
        ("allows", lambda T, joints: True, "2 truth values"),
        ("allows", lambda T, joints: np.ones(len(T)), "2 truth values"),
        ("allows_palm", lambda T, joints: [True], "2 truth values"),
        ("nearest", lambda T, joints: T[:, :3], r"shape \(2, 4, 4\)"),
        ("nearest", lambda T, joints: np.nan * T, r"finite numbers of shape \(2, 4, 4\)"),
        ("nearest", lambda T, joints: 1 / 0, r"raised ZeroDivisionError.*in nearest\(\)"),
    ],
)
def test_a_wrong_answer_is_named(part, method: str, answer, match: str) -> None:
    band = Band(Situation(load_hand("barrett_bh280"), part, Place()))
    setattr(band, method, answer)
    T, joints = np.tile(np.eye(4), (2, 1, 1)), np.zeros((2, 8))
    with pytest.raises(RequestError, match=match) as caught:
        getattr(OwnConstraint("mine", band), method)(T, joints)
    assert "'mine'" in str(caught.value)


def test_a_wrong_verdict_ends_the_plan_with_its_name(part, offer) -> None:
    class OneForAll(Band):
        def verdict(self, closed: ClosedHands) -> Verdict:
            return Verdict.clear(1)

    offer(OneForAll)
    with pytest.raises(RequestError, match=r"verdict\(\) of the constraint 'mine' gave Verdict"):
        planned(part, "mine")


def test_a_changed_rule_is_another_condition_of_the_store(
    part, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    rule = tmp_path / "rule_of_the_cell.py"
    rule.write_text("def RULE(situation): ...\n")
    settings = PlannerSettings.from_mapping({"constraints": {"names": ["rule_of_the_cell:RULE"]}})
    hand = load_hand("barrett_bh280")
    before = Conditions.of(part, PlanRequest(), settings, hand).key
    assert before == Conditions.of(part, PlanRequest(), settings, hand).key
    rule.write_text("def RULE(situation): ...  # changed\n")
    assert Conditions.of(part, PlanRequest(), settings, hand).key != before
    [(name, digest)] = identities(settings.constraints).items()
    assert (name, len(digest)) == ("rule_of_the_cell:RULE", 64)
    sys.modules.pop("rule_of_the_cell")


def test_the_search_in_pybullet_refuses_it(part) -> None:
    settings = PlannerSettings.from_mapping(
        {
            "constraints": {"names": [f"{__name__}:Band"]},
            "scene": {"search_evaluator": "bullet"},
        }
    )
    with pytest.raises(RequestError, match="knows no constraints"):
        GraspPlanner(settings).plan(part, PlanRequest(max_evaluations=10))
