"""Asynchronous successive halving: who goes on, for how long, and what it finds."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from gpis_grasp_planner.optimise.successive_halving import SuccessiveHalving


def run_tournament(values, n_rungs, ratio, n_jobs):
    """Drive it with starts whose value never changes; returns the jobs (start, rung) in order."""
    halving = SuccessiveHalving(n_rungs, ratio)
    jobs, begun = [], 0
    for _ in range(n_jobs):
        job = halving.promote()
        if job is None:
            job = (begun, 0)
            begun += 1
        jobs.append(job)
        halving.report(*job, values[job[0]])
    return jobs


def test_the_first_jobs_by_hand():
    # Ratio 2: one of two goes on, then one of four as well, and the better of those two again.
    jobs = run_tournament([0.1, 0.4, 0.3, 0.2], n_rungs=3, ratio=2, n_jobs=7)
    assert jobs == [(0, 0), (1, 0), (1, 1), (2, 0), (3, 0), (2, 1), (1, 2)]


@pytest.mark.parametrize(("ratio", "n_rungs"), [(2, 6), (3, 4)])
def test_no_rung_holds_more_than_its_share_of_the_one_below(ratio, n_rungs, rng):
    values = rng.random(1000)
    jobs = run_tournament(values, n_rungs, ratio, 900)
    n = [sum(rung == k for _, rung in jobs) for k in range(n_rungs)]
    assert sum(n) == 900
    for below, above in itertools.pairwise(n):
        # One may be due that the last job gave no time for.
        assert below // ratio - above in (0, 1)
    assert len(set(jobs)) == len(jobs), "nobody does a rung twice"


def test_a_late_good_one_goes_on_as_soon_as_there_is_room():
    values = np.append(np.linspace(0.5, 0.6, 20), np.append(1.0, np.full(20, 0.1)))
    jobs = run_tournament(values, 3, 2, 60)
    for rung in (1, 2):
        arrived = jobs.index((20, rung - 1))
        promoted = [start for start, r in jobs[arrived:] if r == rung]
        assert promoted[0] == 20, "nobody is taken before it"


def test_only_the_better_part_of_a_rung_goes_on(rng):
    values = rng.random(500)
    jobs = run_tournament(values, 4, 2, 400)
    for index, (start, rung) in enumerate(jobs):
        if rung:
            rivals = [values[s] for s, r in jobs[:index] if r == rung - 1]
            assert np.sum(np.array(rivals) > values[start]) < len(rivals) // 2


def test_the_best_of_all_gets_to_the_top(rng):
    values = rng.random(64)
    values[37] = 2.0
    jobs = run_tournament(values, 4, 2, 120)
    assert {rung for start, rung in jobs if start == 37} == {0, 1, 2, 3}
    # The top is the end: nobody is promoted beyond it.
    assert max(rung for _, rung in jobs) == 3


def test_turns_add_up_to_the_powers_of_the_ratio():
    halving = SuccessiveHalving(6, 2)
    assert [halving.turns(k) for k in range(6)] == [1, 1, 2, 4, 8, 16]
    assert sum(SuccessiveHalving(4, 3).turns(k) for k in range(4)) == 27


def test_with_one_rung_every_start_is_new():
    assert run_tournament(np.ones(5), 1, 2, 5) == [(k, 0) for k in range(5)]


@pytest.mark.parametrize(("n_rungs", "ratio"), [(0, 2), (3, 1)])
def test_impossible_settings_raise(n_rungs, ratio):
    with pytest.raises(ValueError, match="rung"):
        SuccessiveHalving(n_rungs, ratio)


def test_more_starts_in_the_same_work_than_searching_each_to_its_end(rng):
    """A known answer: values grow by 1 / turns towards a limit that early values hardly tell."""
    limits = rng.random(4000)
    early = 0.3 * limits + 0.2 * rng.random(4000)

    def value(start, turns):
        return limits[start] + (early[start] - limits[start]) / turns

    halving, best, work, begun = SuccessiveHalving(6, 2), 0.0, 0, 0
    done: dict[int, int] = {}
    while work < 1600:
        job = halving.promote()
        if job is None:
            job, begun = (begun, 0), begun + 1
        start, rung = job
        work += halving.turns(rung)
        done[start] = done.get(start, 0) + halving.turns(rung)
        best = max(best, value(start, done[start]))
        halving.report(start, rung, value(start, done[start]))
    full = max(value(start, 32) for start in range(1600 // 32))
    assert begun > 300
    assert best >= full
