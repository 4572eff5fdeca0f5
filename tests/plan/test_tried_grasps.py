"""The order of an answer after its trials, and what is said of them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.plan.tried_grasps import TriedGrasps, payload_note
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.quality.objective import EpsilonVolume
from gpis_grasp_planner.verification.hold_model import HoldModel
from gpis_grasp_planner.verification.settings import VerificationSettings


def grasp(x_mm: float, epsilon: float) -> Grasp:
    T = np.eye(4)
    T[0, 3] = 1e-3 * x_mm
    still = np.zeros(8)
    return Grasp(T, still, still, Contacts.none(), Quality(epsilon, 0.0), T[:3, 2], 0.1)


def physics(verdicts, n_lost=0):
    """Trials that know verdicts by the palm's x [mm]: passed or not, per case."""
    model = HoldModel()

    def with_trials(grasp):
        outcomes = verdicts.get(round(1e3 * grasp.T_object_palm[0, 3]))
        if outcomes is not None:
            made = (TrialOutcome("case", ok, "" if ok else "slipped") for ok in outcomes)
            grasp = replace(grasp, trials=Trials(tuple(made)))
        return replace(grasp, hold_estimate=model.estimate(grasp))

    return SimpleNamespace(with_trials=with_trials, n_lost=n_lost)


GRASPS = [grasp(0, 0.3), grasp(100, 0.2), grasp(200, 0.1), grasp(300, 0.05)]


def places(grasps):
    return [round(1e3 * g.T_object_palm[0, 3]) for g in grasps]


def test_what_held_comes_first_what_failed_last_whatever_epsilon_says():
    tried = TriedGrasps.of(
        GRASPS, physics({0: [False], 200: [True], 300: [True, True]}), 0.1, EpsilonVolume(0.5)
    )
    assert places(tried.ranked) == [300, 200, 100, 0]
    assert places(tried.held) == [300, 200]
    assert tried.n_tried == 3
    assert tried.notes == (
        "Tried in physics: 3 grasps, of which 2 held; there was no time to try 1 more.",
    )


def test_where_nothing_held_the_causes_are_counted():
    tried = TriedGrasps.of(GRASPS, physics({0: [False], 200: [False]}), 0.1, EpsilonVolume(0.5))
    assert tried.held == ()
    assert tried.why_none == "slipped 2, not tried 2"
    assert TriedGrasps.of(GRASPS, physics({}), 0.1, EpsilonVolume(0.5)).why_none.startswith(
        "none could be tried"
    )


def test_of_neighbours_the_one_that_held_is_kept():
    near = [grasp(0, 0.3), grasp(5, 0.2), grasp(100, 0.1)]
    tried = TriedGrasps.of(near, physics({5: [True]}), 0.1, EpsilonVolume(0.5))
    assert places(tried.ranked) == [5, 100]


def test_nothing_tried_is_said_with_the_losses():
    tried = TriedGrasps.of(GRASPS, physics({}, n_lost=2), 0.1, EpsilonVolume(0.5))
    assert places(tried.ranked) == [0, 100, 200, 300]
    assert "No grasp could be tried" in tried.notes[0]
    assert "2 trials were lost" in tried.notes[1]


def test_where_nothing_was_to_be_tried_more_time_is_not_asked_for():
    none = TriedGrasps.of([], physics({}), 0.1, EpsilonVolume(0.5))
    assert none.ranked == ()
    assert none.notes == ()


@pytest.mark.parametrize(("mass", "said"), [(5.9, False), (6.2, True)])
def test_a_part_over_the_payload_is_named(mass, said, sphere):
    note = payload_note(replace(sphere, mass=mass), VerificationSettings())
    assert bool(note) is said
    if said:
        assert "6.2 kg" in note[0]
        assert "payload of 6 kg" in note[0]
        assert "0.1 kg" in note[0]
