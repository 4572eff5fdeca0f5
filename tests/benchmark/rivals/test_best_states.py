"""The list of best distinct states against its rules."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from gpis_grasp_benchmark.rivals.best_states import BestStates
from gpis_grasp_planner.geometry.transforms import transform

RADIUS = 0.08


def pose(x):
    T = np.eye(4)
    T[0, 3] = x * RADIUS
    return T


def test_near_better_ones_stay_and_near_worse_ones_go():
    best = BestStates(RADIUS, n=3, apart=0.2)
    assert best.worst_energy == np.inf
    assert best.offer(5.0, np.array([0.0]), pose(0.0))
    assert not best.offer(6.0, np.array([1.0]), pose(0.1))
    assert not best.offer(5.0, np.array([1.0]), pose(0.1))
    assert best.offer(4.0, np.array([2.0]), pose(0.1))
    assert [entry.energy for entry in best.entries] == [4.0]
    assert best.offer(7.0, np.array([3.0]), pose(0.5))
    # near both, better than one, worse than the other
    assert not best.offer(5.0, np.array([4.0]), pose(0.29))
    assert best.offer(1.0, np.array([5.0]), pose(-1.0))
    assert [entry.energy for entry in best.entries] == [1.0, 4.0, 7.0]
    assert best.worst_energy == 7.0


def test_a_full_list_drops_its_worst():
    best = BestStates(RADIUS, n=2, apart=0.2)
    for energy, x in ((3.0, 0.0), (2.0, 1.0), (1.0, 2.0)):
        assert best.offer(energy, np.zeros(1), pose(x))
    assert [entry.energy for entry in best.entries] == [1.0, 2.0]
    assert not best.offer(2.5, np.zeros(1), pose(5.0))
    assert len(best) == 2


def test_entries_are_sorted_distinct_and_new(rng, oracle):
    best = BestStates(RADIUS, n=20, apart=0.2)
    R = Rotation.random(600, rng=rng).as_matrix()
    T = transform(R, rng.uniform(-0.05, 0.05, (600, 3)))
    energy = rng.uniform(0.0, 1.0, 600)
    seen = []
    for i in range(600):
        taken = best.offer(energy[i], np.array([float(i)]), T[i])
        assert taken == any(entry.state[0] == i for entry in best.entries)
        for entry in best.entries:
            if entry.state[0] == i:
                assert not entry.closed
            entry.closed = True
        seen.append(best.entries[0].energy)
    energies = [entry.energy for entry in best.entries]
    assert energies == sorted(energies)
    assert len(best) == 20
    # The best of all is never lost, and improvements are monotone.
    assert energies[0] == energy.min()
    assert np.all(np.diff(seen) <= 0.0)
    for i, a in enumerate(best.entries):
        for b in best.entries[:i]:
            assert oracle.apart(a.T_object_face, b.T_object_face, RADIUS) >= 0.2 - 1e-9
