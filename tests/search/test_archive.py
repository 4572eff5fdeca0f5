"""The distance rule between grasps, and the archive that must not lose its best."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.grasp.order import DISTINCT, are_near, distinct, pose_difference
from gpis_grasp_planner.quality.objective import EpsilonVolume
from gpis_grasp_planner.search.archive import GraspArchive

RADIUS = 0.08
WEIGHT = 0.5


def random_poses(rng, n, reach=0.1):
    R = Rotation.random(n, rng=rng).as_matrix()
    return transform(R, rng.uniform(-reach, reach, (n, 3)))


def objective(epsilon, volume):
    """f_obj of the paper with its indicator: 0 for x <= 0, else 1."""
    return (epsilon if epsilon > 0.0 else 0.0) + WEIGHT * volume


@pytest.mark.parametrize(
    ("shift", "angle", "expected"),
    [
        (0.0, 0.0, 0.0),
        (0.2 * RADIUS, 0.0, 0.2),
        (RADIUS, 0.0, 1.0),
        (3.0 * RADIUS, 0.1, 3.0),
        (0.0, np.pi, 0.5),
        (0.0, np.pi / 2, 0.25),
        (0.0, 0.4 * np.pi, 0.2),
        (0.1 * RADIUS, np.pi / 2, 0.25),
        (0.3 * RADIUS, np.pi / 2, 0.3),
    ],
)
def test_known_differences(shift, angle, expected, rng, oracle):
    T = random_poses(rng, 1)[0]
    axis = rng.standard_normal(3)
    other = T.copy()
    other[:3, :3] = T[:3, :3] @ oracle.rotation_about(axis, angle)
    other[:3, 3] += shift * np.array([2.0, -1.0, 2.0]) / 3.0
    assert_allclose(pose_difference(T, other, RADIUS), expected, atol=1e-12)
    assert_allclose(pose_difference(other, T, RADIUS), expected, atol=1e-12)


def test_difference_is_that_of_each_pair(rng, oracle):
    A, B = random_poses(rng, 60), random_poses(rng, 60)
    expected = [oracle.apart(a, b, RADIUS) for a, b in zip(A, B, strict=True)]
    assert_allclose(pose_difference(A, B, RADIUS), expected, atol=1e-7)


def test_choice_is_greedy_distinct_and_leaves_nothing_that_would_fit(rng, oracle):
    T = random_poses(rng, 150, reach=0.05)
    order = rng.permutation(150)
    chosen = distinct(T, order, RADIUS, 150)
    assert chosen[0] == order[0]
    rank = {int(i): k for k, i in enumerate(order)}
    assert [rank[i] for i in chosen] == sorted(rank[i] for i in chosen)
    for a, i in enumerate(chosen):
        for j in chosen[a + 1 :]:
            assert oracle.apart(T[i], T[j], RADIUS) >= DISTINCT - 1e-9
    for i in set(range(150)) - set(chosen):
        better = [j for j in chosen if rank[j] < rank[i]]
        assert min(oracle.apart(T[i], T[j], RADIUS) for j in better) < DISTINCT + 1e-9
    assert distinct(T, order, RADIUS, 7) == chosen[:7]


def test_the_rule_is_that_of_the_original_list():
    assert DISTINCT == 0.2


def test_objective_is_the_papers_with_its_indicator(oracle, rng):
    epsilon = np.array([-1.0, 0.0, 1e-9, 0.07, 0.2, 0.3])
    volume = np.array([0.4, 0.4, 0.0, 0.1, 0.0, 0.2])
    attempts = oracle.make_attempts(random_poses(rng, 6), epsilon, volume)
    expected = [objective(e, v) for e, v in zip(epsilon, volume, strict=True)]
    assert_allclose(attempts.objective(EpsilonVolume(WEIGHT)), expected, rtol=1e-15)
    assert_allclose(attempts.objective(EpsilonVolume(0.0)), np.maximum(epsilon, 0.0))


@pytest.mark.parametrize("status", [s for s in AttemptStatus if s != AttemptStatus.GRASPED])
def test_failed_attempts_are_worth_nothing_and_are_not_kept(status, oracle, rng):
    attempts = oracle.make_attempts(random_poses(rng, 3), [0.3] * 3, [1.0] * 3, [status] * 3)
    archive = GraspArchive(RADIUS, EpsilonVolume(WEIGHT))
    archive.add(attempts)
    assert attempts.objective(EpsilonVolume(WEIGHT)).tolist() == [0.0] * 3
    assert len(archive) == 0
    assert archive.best_epsilon == -1.0
    assert archive.best(5) == []
    assert archive.best_attempt is None


def test_archive_takes_force_closure_only_and_remembers_the_best_of_the_rest(oracle, rng):
    archive = GraspArchive(RADIUS, EpsilonVolume(WEIGHT))
    archive.add(oracle.make_attempts(random_poses(rng, 3), [-1.0, -1.0, -1.0], [0.1, 0.3, 0.2]))
    assert len(archive) == 0
    assert archive.best_attempt.index == 1
    assert archive.best_attempt.objective == pytest.approx(WEIGHT * 0.3)
    archive.add(oracle.make_attempts(random_poses(rng, 2), [-1.0, 0.05], [0.2, 0.0]))
    assert len(archive) == 1
    assert archive.best_epsilon == 0.05
    assert archive.best(3)[0].epsilon == 0.05


def test_empty_batches_change_nothing(oracle):
    archive = GraspArchive(RADIUS, EpsilonVolume(WEIGHT))
    archive.add(oracle.make_attempts(np.zeros((0, 4, 4)), []))
    assert len(archive) == 0
    assert archive.best_attempt is None


@pytest.mark.parametrize("reach", [0.01, 0.3])
def test_archive_never_loses_the_best_objective_nor_the_best_epsilon(reach, oracle, rng):
    # Crowded (reach 0.01) as well as wide: thinning drops neighbours of better grasps, and the
    # best epsilon may well be such a neighbour where another has the larger volume.
    archive = GraspArchive(RADIUS, EpsilonVolume(WEIGHT), capacity=20)
    best_objective = best_epsilon = -1.0
    for _ in range(60):
        T = random_poses(rng, 8, reach)
        T[:, :3, :3] = Rotation.from_rotvec(rng.normal(0.0, 10 * reach, (8, 3))).as_matrix()
        epsilon, volume = rng.uniform(-0.05, 0.2, 8), rng.uniform(0.0, 0.5, 8)
        epsilon[epsilon <= 0.0] = -1.0
        archive.add(oracle.make_attempts(T, epsilon, volume))
        best_objective = max(
            best_objective,
            *(objective(e, v) for e, v in zip(epsilon, volume, strict=True) if e > 0.0),
            -1.0,
        )
        best_epsilon = max(best_epsilon, epsilon.max())
        assert archive.best_epsilon == best_epsilon
        assert len(archive) <= 3 * 20
        if best_objective > 0.0:
            assert archive.best(1)[0].objective == pytest.approx(best_objective, rel=1e-15)


def test_the_chosen_are_best_first_and_apart(oracle, rng):
    archive = GraspArchive(RADIUS, EpsilonVolume(WEIGHT))
    for _ in range(40):
        archive.add(
            oracle.make_attempts(
                random_poses(rng, 10, 0.06), rng.uniform(0.01, 0.2, 10), rng.uniform(0, 0.2, 10)
            )
        )
    chosen = archive.best(20)
    assert len(chosen) == 20
    values = [c.objective for c in chosen]
    assert values == sorted(values, reverse=True)
    for a, first in enumerate(chosen):
        for second in chosen[a + 1 :]:
            assert oracle.apart(first.T_object_palm, second.T_object_palm, RADIUS) >= 0.2 - 1e-9


def test_thinning_leaves_the_answer_as_it_was(oracle, rng):
    batches = [
        oracle.make_attempts(random_poses(rng, 10, 0.4), rng.uniform(0.01, 0.2, 10))
        for _ in range(80)
    ]
    full, thinned = (
        GraspArchive(RADIUS, EpsilonVolume(WEIGHT), 10**6),
        GraspArchive(RADIUS, EpsilonVolume(WEIGHT), 160),
    )
    for batch in batches:
        full.add(batch)
        thinned.add(batch)
    assert len(full) == 800
    assert len(thinned) <= 480
    expected = [c.epsilon for c in full.best(20)]
    assert [c.epsilon for c in thinned.best(20)] == expected


def test_equal_figures_keep_their_order(oracle):
    T = np.tile(np.eye(4), (5, 1, 1))
    T[:, 0, 3] = np.arange(5) * RADIUS
    archive = GraspArchive(RADIUS, EpsilonVolume(WEIGHT))
    archive.add(oracle.make_attempts(T, [0.1] * 5))
    assert [c.index for c in archive.best(5)] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("apart", [0.05, DISTINCT, 0.5, 0.7])
def test_nearness_is_the_distance_rule(rng, apart):
    # Small turns about a common pose, so that the rule for angles decides as well.
    turns = Rotation.from_rotvec(3.0 * apart * rng.uniform(-1.0, 1.0, (300, 3)))
    T = transform(turns.as_matrix(), apart * rng.uniform(-RADIUS, RADIUS, (300, 3)))
    expected = pose_difference(T[:100, None], T[None, 100:], RADIUS) < apart
    assert 0.01 < expected.mean() < 0.999
    np.testing.assert_array_equal(are_near(T[:100], T[100:], RADIUS, apart), expected)


def test_what_a_grasp_has_to_beat(oracle):
    def lifted(T):
        place = T.copy()
        place[:, 2, 3] += 0.05
        return place

    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, 0, 3] = [0.0, RADIUS, 2 * RADIUS]
    archive = GraspArchive(RADIUS, EpsilonVolume(WEIGHT))
    assert archive.to_beat(lifted(T), lifted).tolist() == [0.0, 0.0, 0.0]
    archive.add(oracle.make_attempts(T, [0.3, 0.2, 0.1]))
    far = np.eye(4)
    far[1, 3] = 10 * RADIUS
    asked = lifted(np.concatenate([T, far[None]]))
    # Not full: free ground is free, the listed hold their places.
    assert archive.to_beat(asked, lifted, n=4).tolist() == [0.3, 0.2, 0.1, 0.0]
    # Full: elsewhere the last has to be beaten.
    assert archive.to_beat(asked, lifted, n=3).tolist() == [0.3, 0.2, 0.1, 0.1]
    assert archive.to_beat(asked, lifted, n=2).tolist() == [0.3, 0.2, 0.2, 0.2]
    archive.add(oracle.make_attempts(far[None], [0.5]))
    assert archive.to_beat(asked, lifted, n=2).tolist() == [0.3, 0.3, 0.3, 0.5]
    # Just inside the distance rule it is still the listed one's place.
    asked[0, 0, 3] -= 0.19 * RADIUS
    asked[3, 1, 3] += 0.21 * RADIUS
    assert archive.to_beat(asked, lifted, n=2)[[0, 3]].tolist() == [0.3, 0.3]
