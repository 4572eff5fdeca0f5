"""The hull-free epsilon against the exact one."""

import numpy as np
import pytest

from gpis_grasp_planner.quality.fast_epsilon import fast_epsilon, start_directions
from gpis_grasp_planner.quality.wrench_space import contact_wrenches, hull_quality

DIRECTIONS = start_directions(256)
# As the compiled evaluator asks: few starts, and more where the first answer is good.
STARTS, STARTS_OF_GOOD, GOOD = 5, 20, 0.01


def evaluators_epsilon(W):
    return fast_epsilon(W, DIRECTIONS, STARTS, STARTS_OF_GOOD - STARTS, GOOD)


def wrenches(contacts):
    return contact_wrenches(contacts, np.zeros(3), 1.0)


def test_upper_bound_always_exact_nearly_always_and_the_verdict_agrees(random_grasps):
    exact_ones = closed = total = 0
    for contacts in random_grasps(100):
        W = wrenches(contacts)
        fast, exact = evaluators_epsilon(W), hull_quality(W).epsilon
        total += 1
        if exact > 1e-6:
            assert fast >= exact - 1e-9
            closed += 1
            exact_ones += fast <= exact + 1e-7
        elif exact < 0.0:
            assert fast < 1e-6
            exact_ones += 1
    print(f"{exact_ones} of {total} exact, {closed} closed")
    assert closed > 30
    assert total - exact_ones <= 0.01 * total


def test_more_starts_for_the_good_are_those_of_more_starts_at_once(random_grasps):
    good = 0
    for contacts in random_grasps(40):
        # a number of edges that does not fill the lanes
        W = contact_wrenches(contacts, np.zeros(3), 1.0, 5)
        few = fast_epsilon(W, DIRECTIONS, STARTS)
        expected = fast_epsilon(W, DIRECTIONS, STARTS_OF_GOOD) if few > GOOD else few
        assert evaluators_epsilon(W) == expected
        good += few > GOOD
    assert good > 5


def test_one_start_already_bounds_from_above_and_more_starts_never_raise_it(random_grasps):
    for contacts in random_grasps(25):
        W = wrenches(contacts)
        answers = [fast_epsilon(W, DIRECTIONS, n) for n in (1, 3, 10, 40)]
        exact = hull_quality(W).epsilon
        if exact > 0.0:
            assert (np.diff(answers) <= 1e-12).all()
            assert answers[-1] >= exact - 1e-9
        else:
            assert answers[-1] == -1.0


def test_answers_known_by_hand():
    cross = np.vstack([np.eye(6), -np.eye(6)])
    assert fast_epsilon(cross, DIRECTIONS, 5) == pytest.approx(1.0 / np.sqrt(6.0))
    cube = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T.copy()
    assert fast_epsilon(cube, DIRECTIONS, 5) == pytest.approx(1.0)
    assert fast_epsilon(cube + 0.25 * np.eye(6)[2], DIRECTIONS, 5) == pytest.approx(0.75)


def test_no_closure_where_the_origin_is_outside_on_the_border_or_the_space_is_flat(rng):
    cube = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1).T.copy()
    for shift in (1.0, 1.0 + 1e-9, 1.5, 30.0):
        assert fast_epsilon(cube + shift * np.eye(6)[0], DIRECTIONS, 5) < 1e-8
    flat = cube.copy()
    flat[:, 4] = 0.0
    Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    assert fast_epsilon(np.ascontiguousarray(flat @ Q), DIRECTIONS, 5) == -1.0
    assert fast_epsilon(cube[:6], DIRECTIONS, 5) == -1.0
    assert fast_epsilon(np.zeros((40, 6)), DIRECTIONS, 5) == -1.0


def test_two_point_contacts_never_close(grasp_of, rng):
    for _ in range(30):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        assert evaluators_epsilon(wrenches(grasp_of([n, -n], [-n, n], 0.5))) == -1.0


def test_leaves_its_arguments_alone_and_repeats_itself(random_grasps):
    W = wrenches(random_grasps(1)[0])
    before, directions = W.copy(), DIRECTIONS.copy()
    first = fast_epsilon(W, DIRECTIONS, 20)
    assert fast_epsilon(W, DIRECTIONS, 20) == first
    np.testing.assert_array_equal(W, before)
    np.testing.assert_array_equal(DIRECTIONS, directions)


def test_start_directions_are_unit_and_repeat():
    np.testing.assert_allclose(np.linalg.norm(DIRECTIONS, axis=1), 1.0)
    np.testing.assert_array_equal(start_directions(256), DIRECTIONS)
    assert not np.array_equal(start_directions(256, seed=1), DIRECTIONS)
