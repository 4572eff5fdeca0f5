"""Candidates finished once: what is seen by PyBullet's scene, when, and what it drops."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.grasp.funnel import Loss, Step
from gpis_grasp_planner.grasp.tally import Tally
from gpis_grasp_planner.plan.confirming_scene import ConfirmingScene
from gpis_grasp_planner.plan.finisher import Finisher
from gpis_grasp_planner.plan.placed_grasps import GraspPlacing
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import Surroundings


@pytest.fixture
def make_finisher(searched_mug, planner):
    """A finisher of the mug in free space; each call of its clock is a second later."""

    def make(confirmed):
        prepared = planner.prepare(searched_mug.part)
        placing = GraspPlacing(planner.hand, Surroundings(), ClearanceSettings(), prepared.tree)
        tally = Tally()
        tally.proposed = 300
        clock = map(float, itertools.count())
        return Finisher(searched_mug, placing, confirmed, lambda: next(clock), tally)

    return make


def test_nothing_is_shown_twice(make_finisher):
    seen = []
    finisher = make_finisher(lambda grasp: seen.append(grasp) is None)
    first = finisher.best(4)
    assert len(first) == 4
    again = finisher.best(4)
    assert [id(grasp) for grasp in again] == [id(grasp) for grasp in first]
    assert len(seen) == finisher.n_seen == len({g.T_object_palm.tobytes() for g in seen}) == 5


def test_what_was_not_seen_yet_is_offered_but_does_not_stand(make_finisher):
    seen = []
    finisher = make_finisher(lambda grasp: seen.append(grasp) is None)
    [offered] = finisher.best(4, fresh=1, seen=False)
    assert not seen
    assert finisher.finished() == []
    assert not finisher.stands(offered)
    finisher.see()
    assert [id(grasp) for grasp in seen] == [id(offered)]
    assert [id(grasp) for grasp in finisher.finished()] == [id(offered)]
    assert finisher.stands(offered)


def test_what_the_scene_does_not_agree_with_is_dropped_whenever_it_looks(make_finisher):
    finisher = make_finisher(lambda _grasp: False)
    [offered] = finisher.best(4, fresh=1, seen=False)
    finisher.see()
    assert not finisher.stands(offered)
    assert finisher.best(4) == []
    assert finisher.finished() == []
    assert finisher.n_disagreed == finisher.n_seen == 5
    assert finisher.tally.lost[Step.CONFIRMED, Loss.SCENE] == 5


def test_an_answer_is_never_of_what_was_not_seen(make_finisher):
    odd = itertools.cycle([True, False])
    finisher = make_finisher(lambda _grasp: next(odd))
    finisher.best(4, fresh=2, seen=False)
    answered = finisher.best(4)
    assert answered
    assert all(finisher.stands(grasp) for grasp in answered)
    assert finisher.n_seen == 5


def test_the_order_does_not_depend_on_when_the_scene_looks(make_finisher):
    at_once, later = make_finisher(lambda _grasp: True), make_finisher(lambda _grasp: True)
    for _ in range(5):
        later.best(4, fresh=1, seen=False)
        later.see()
    for one, other in zip(at_once.best(4), later.best(4), strict=True):
        assert one.T_object_palm.tobytes() == other.T_object_palm.tobytes()
        assert one.epsilon == other.epsilon


def test_no_candidate_is_begun_that_would_be_late_but_the_first(make_finisher):
    finisher = make_finisher(lambda _grasp: True)
    assert len(finisher.best(4, until=0.0)) == 1


def test_the_cost_is_of_the_whole_finish(make_finisher):
    """By the clock above: a second at once; a second for the placing, one for a later look."""
    at_once, later = make_finisher(lambda _grasp: True), make_finisher(lambda _grasp: True)
    at_once.best(4, fresh=1)
    assert at_once.cost_s == 1.0
    later.best(4, fresh=1, seen=False)
    later.see()
    assert later.cost_s == 2.0
    assert later.time_for(4) == 4 * 2.0


def test_a_hand_that_comes_through_the_part_is_dropped_and_counted(make_finisher, monkeypatch):
    finisher = make_finisher(lambda _: True)
    monkeypatch.setattr(
        "gpis_grasp_planner.plan.placed_grasps.meets_part_on_approach",
        lambda _hand, grasps, _tree: np.ones(len(grasps), dtype=bool),
    )
    assert finisher.best(4) == []
    assert finisher.tally.lost[Step.CONFIRMED, Loss.WAY_BACK] == 5
    assert not finisher.finished()


def test_pybullets_scene_agrees_with_grasps_and_not_with_one_that_is_moved(
    make_finisher, searched_mug, planner
):
    part = searched_mug.part
    prepared = planner.prepare(part)
    settings = planner.settings.scene
    with ConfirmingScene(part, planner.hand, part.friction, settings, prepared) as scene:
        finisher = make_finisher(scene.agrees)
        grasps = finisher.best(4)
        assert grasps
        away = np.array(grasps[0].T_object_palm)
        away[:3, 3] -= 0.02 * away[:3, 2]
        assert not scene.agrees(replace(grasps[0], T_object_palm=away))
        off = replace(settings, confirm=False)
        with ConfirmingScene(part, planner.hand, part.friction, off, prepared) as blind:
            assert blind.agrees(replace(grasps[0], T_object_palm=away))


def test_something_may_be_done_before_each_candidate_that_is_finished_and_no_other(make_finisher):
    n_seen: list[int] = []
    finisher = make_finisher(lambda _grasp: True)
    finisher.best(4, fresh=2)
    finisher.best(4, meanwhile=lambda: n_seen.append(finisher.n_seen))
    assert n_seen == [2, 3, 4]
    finisher.best(4, meanwhile=lambda: n_seen.append(-1))
    assert n_seen == [2, 3, 4]


class Foreseen:
    """Stands in for the case balance: figures by the place in the archive's list, largest last."""

    def __init__(self, archive, n):
        self.at = {c.T_object_palm.tobytes(): k for k, c in enumerate(archive.best(n))}
        self.looked_at = []

    def of_candidate(self, candidate):
        self.looked_at.append(self.at[candidate.T_object_palm.tobytes()])
        return 10.0 ** self.looked_at[-1]

    def knows(self, candidate):
        return self.at[candidate.T_object_palm.tobytes()] in self.looked_at

    def judged(self, grasp):
        return grasp


def places(foreseen, grasps):
    return sorted(foreseen.at[grasp.T_object_palm.tobytes()] for grasp in grasps)


def test_half_is_the_best_and_half_what_the_trials_cases_leave_most_of(make_finisher, searched_mug):
    finisher = make_finisher(lambda _grasp: True)
    foreseen = finisher.in_cases = Foreseen(searched_mug.archive, 15)
    finisher.best(4)  # five of fifteen are finished
    assert places(foreseen, finisher.finished()) == [0, 1, 2, 13, 14]
    assert sorted(foreseen.looked_at) == list(range(3, 15))


def test_the_time_that_is_kept_is_that_of_what_will_be_finished(make_finisher, searched_mug):
    finisher = make_finisher(lambda _grasp: True)
    foreseen = finisher.in_cases = Foreseen(searched_mug.archive, 60)
    finisher.best(4)
    looked_at = set(foreseen.looked_at)
    assert finisher.time_for(4) == 0.0  # all five that would be chosen are finished
    assert finisher.time_for(8) > 0.0
    assert set(foreseen.looked_at) == looked_at


def test_beside_a_search_few_are_looked_at_and_none_before_the_first_is_offered(
    make_finisher, searched_mug
):
    finisher = make_finisher(lambda _grasp: True)
    foreseen = finisher.in_cases = Foreseen(searched_mug.archive, 15)
    finisher.best(4, fresh=1)
    assert places(foreseen, finisher.finished()) == [0]
    assert foreseen.looked_at == []
    for n in (4, 8, 12):
        finisher.best(4, fresh=1)
        assert len(set(foreseen.looked_at)) == n


def test_when_it_is_late_none_are_looked_at(make_finisher, searched_mug):
    finisher = make_finisher(lambda _grasp: True)
    foreseen = finisher.in_cases = Foreseen(searched_mug.archive, 15)
    finisher.best(4, until=0.0)
    assert foreseen.looked_at == []
