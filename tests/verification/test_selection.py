"""Which grasps become the answer after their trials, and which stay in reserve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.reserve import Reserve
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.verification.cases import TrialCase
from gpis_grasp_planner.verification.selection import Selection, select

FAR = 1e9


@dataclass
class KnownTrials:
    """Trials whose outcomes are given by the palm's x [mm]: cases passed; the others untried."""

    hand: HandDescription
    passed: dict[int, int]
    asked: list[int] = field(default_factory=list)

    def run(
        self, grasps: Sequence[Grasp], cases: Sequence[TrialCase], *_: object
    ) -> list[Trials | None]:
        places = [round(1e3 * g.T_object_palm[0, 3]) for g in grasps]
        self.asked += places
        return [
            Trials(tuple(TrialOutcome(str(k), k < self.passed[x], "slipped") for k in range(3)))
            if x in self.passed
            else None
            for x in places
        ]


@pytest.fixture
def grasp(firm: Grasp):
    """Maker of grasps by the palm's x [mm] and epsilon."""

    def make(x_mm: int, epsilon: float) -> Grasp:
        T = transform(np.eye(3), [1e-3 * x_mm, 0.0, 0.0]) @ firm.T_object_palm
        T[0, 3] = 1e-3 * x_mm
        return replace(firm, T_object_palm=T, epsilon=epsilon, volume=0.0)

    return make


def places(grasps: Sequence[Grasp]) -> list[int]:
    return [round(1e3 * g.T_object_palm[0, 3]) for g in grasps]


@pytest.fixture
def selected(hand: HandDescription, grasp) -> Selection:
    """Finalists 1 (fails), 2 (untried), 3 (holds); reserve 11 (holds, passes more), 12 (fails)."""
    trials = KnownTrials(hand, {1: 0, 3: 1, 11: 3, 12: 0})
    finalists = [grasp(1, 0.3), grasp(2, 0.2), grasp(3, 0.1)]
    reserve = Reserve((grasp(11, 0.05), grasp(12, 0.04), grasp(13, 0.03)))
    return select(trials, [], finalists, reserve, 0.0, FAR)


def test_held_come_before_untried_and_those_before_failed(selected: Selection) -> None:
    assert places(selected.ranked) == [11, 3, 2, 1]
    assert places(selected.held) == [11, 3]
    assert "2 of 4 grasps tried held; 1 of the best" in selected.note


def test_nothing_is_lost_and_nothing_is_there_twice(selected: Selection) -> None:
    for n in (1, 2, 3, 10):
        for only_held in (False, True):
            answer, reserve = selected.split(n, only_held)
            assert places(answer) == [11, 3, 2, 1][: min(n, 2) if only_held else n]
            both = places(answer) + places(reserve.estimates)
            assert sorted(both) == [1, 2, 3, 11, 12, 13]


def test_a_grasp_of_the_reserve_is_answered_with_its_exact_quality(
    selected: Selection, firm: Grasp
) -> None:
    first = selected.ranked[0]
    exact = first.recomputed_quality(np.zeros(3), 1.0, 8)
    assert first.epsilon == exact.epsilon != 0.05
    assert first.trials is not None
    assert first.trials.n_passed == 3


def test_trials_of_what_failed_are_kept(selected: Selection) -> None:
    kept = {x: g.trials for x, g in zip(places(selected.further.estimates),
                                        selected.further.estimates, strict=True)}  # fmt: skip
    assert set(kept) == {12, 13}
    assert kept[12] is not None
    assert not kept[12].held
    assert kept[13] is None


def test_without_a_deadline_the_reserve_is_left_alone(hand: HandDescription, grasp) -> None:
    trials = KnownTrials(hand, {1: 1})
    select(trials, [], [grasp(1, 0.1)], Reserve((grasp(2, 0.1),)), 0.0, None)
    assert trials.asked == [1]


def test_what_is_clear_at_the_present_place_is_tried_first(hand: HandDescription, grasp) -> None:
    """A wall at x = 300 mm stands in the way of the hands beyond it."""
    wall = Surroundings(SupportPlane([0.3, 0.0, 0.0], [-1.0, 0.0, 0.0]))
    trials = KnownTrials(hand, {})
    finalists = [grasp(500, 0.3), grasp(0, 0.2), grasp(400, 0.1)]
    select(trials, [], finalists, Reserve((grasp(10, 0.1),)), 0.0, FAR, around=wall)
    assert trials.asked == [0, 10, 500, 400]


def test_why_none_counts_the_causes(hand: HandDescription, grasp) -> None:
    finalists = [grasp(1, 0.2), grasp(2, 0.1)]
    nothing = select(KnownTrials(hand, {1: 0, 2: 0}), [], finalists, Reserve(), 0.0, FAR)
    assert nothing.why_none == "slipped 2"
    untried = select(KnownTrials(hand, {}), [], finalists, Reserve(), 0.0, FAR)
    assert "none could be tried" in untried.why_none


def test_what_was_tried_is_not_tried_again(hand: HandDescription, grasp) -> None:
    trials = KnownTrials(hand, {1: 0, 2: 0, 3: 2})
    first = select(trials, [], [grasp(1, 0.2)], Reserve((grasp(2, 0.1),)), 0.0, FAR)
    assert trials.asked == [1, 2]
    assert not first.held
    finalists = [grasp(1, 0.2), grasp(3, 0.1)]
    again = select(trials, [], finalists, Reserve((grasp(2, 0.1),)), 0.0, FAR, known=first.known)
    assert trials.asked == [1, 2, 3]
    assert places(again.ranked) == [3, 1]
    assert again.why_none == "slipped 3"
