"""What the contact model says of a grasp in the cases of its trials, without a trial."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.plan.case_balance import CaseBalance
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.balance_factor import balance_factor
from gpis_grasp_planner.search.finalists import grasp_of
from gpis_grasp_planner.verification.cases import finalist_cases
from gpis_grasp_planner.verification.settings import VerificationSettings


@pytest.fixture(scope="module")
def part(catalogue):
    return catalogue.load("mug")


@pytest.fixture(scope="module")
def grasps(planner, part):
    request = PlanRequest(time_budget_s=60.0, max_evaluations=300, seed=2, verification="none")
    found = planner.plan(part, request).grasps
    assert len(found) > 5
    return found


@pytest.fixture
def make(planner, part):
    """The judge of cases by changes of the trials' settings and of the planner's."""

    def made(settings=None, **changes):
        trials = VerificationSettings(**changes)
        friction = PlanRequest().friction_for(part.friction)
        cases = finalist_cases(part, friction, trials, 0)
        return CaseBalance(
            part, planner.hand, settings or PlannerSettings(), planner.prepare(part), cases
        )

    return made


def values(judge, grasps):
    return np.array([judge.judged(grasp).quality.measured["case_balance"] for grasp in grasps])


def test_the_figure_is_added_and_nothing_else_changes(make, grasps):
    judged = make().judged(grasps[0])
    assert 0.0 <= judged.quality.measured["case_balance"] <= 1.0
    rest = {k: v for k, v in judged.quality.measured.items() if k != "case_balance"}
    assert replace(judged.quality, measured=rest) == grasps[0].quality
    assert judged.T_object_palm is grasps[0].T_object_palm


def test_without_any_draw_it_is_the_balance_that_the_search_knows(make, planner, grasps):
    """One case is left, the corner: here the planned friction and the usual mass."""
    judge = make(draws=0, low_friction=0.6, payload_kg=0.2)
    # The palm's friction is another one in the search.
    of_palm = [k for k, group in enumerate(planner.hand.link_friction_group) if group == "palm"]
    off_palm = [grasp for grasp in grasps if not np.isin(of_palm, grasp.contacts.links).any()]
    assert len(off_palm) > 3
    expected = [float(balance_factor(grasp.imbalance)) for grasp in off_palm]
    assert values(judge, off_palm) == pytest.approx(expected, abs=0.02)


def test_harder_cases_leave_less(make, grasps):
    easy = values(make(pose_noise_m=1e-4, pose_noise_deg=0.1), grasps).mean()
    displaced = values(make(pose_noise_m=0.01, pose_noise_deg=10.0), grasps).mean()
    slippery = values(make(low_friction=0.02, high_friction=0.05), grasps).mean()
    assert displaced < easy - 0.1
    assert slippery < easy - 0.1


def test_a_candidate_has_the_figure_of_its_grasp_and_is_looked_at_once(make, searched_mug):
    judge = make()
    for candidate in searched_mug.archive.best(5):
        assert not judge.knows(candidate)
        value = judge.of_candidate(candidate)
        assert judge.knows(candidate)
        [alone] = values(make(), [grasp_of(candidate, searched_mug)])
        assert value == alone == judge.of_candidate(candidate)


def test_a_hand_that_closes_beside_the_part_has_none(make, grasps):
    away = replace(grasps[0], T_object_palm=grasps[0].T_object_palm.copy())
    away.T_object_palm[:3, 3] += [0.6, 0.0, 0.0]
    assert values(make(), [away]) == 0.0


def test_where_the_balance_is_not_asked_for_force_closure_counts(make, grasps):
    judge = make(PlannerSettings.from_mapping({"hpp": {"balance_friction_share": 0.0}}), draws=3)
    found = values(judge, grasps)
    assert set(np.round(4.0 * found, 9)) <= {0.0, 1.0, 2.0, 3.0, 4.0}
    assert (found >= values(make(draws=3), grasps) - 1e-12).all()
