import numpy as np

from gpis_grasp_planner.optimise.observation_window import choose_window


def test_all_are_kept_where_they_fit():
    np.testing.assert_array_equal(choose_window(np.zeros((5, 2)), np.arange(5.0), 5), range(5))


def test_half_are_around_the_best_and_the_rest_spreads():
    rng = np.random.default_rng(1)
    features = np.vstack([0.01 * rng.random((180, 2)), rng.random((20, 2))])
    targets = rng.random(200)
    keep = choose_window(features, targets, 40)
    assert len(set(keep.tolist())) == 40
    assert np.all(np.diff(keep) > 0)
    assert set(np.argsort(-targets)[:5]) <= set(keep)
    # The crowded corner is nine tenths of the points; coverage keeps nearly all of the others.
    assert np.sum(keep >= 180) >= 15


def test_the_unlucky_neighbours_of_the_best_are_kept():
    # Two places of equal worth, one tried five times as often: the mean over what is kept of each
    # is that of all tries there, although the best tries are nearly all at the first place.
    rng = np.random.default_rng(2)
    features = np.concatenate([np.zeros(250), np.ones(50), rng.uniform(2.0, 9.0, 100)])[:, None]
    features[:300] += 1e-3 * rng.standard_normal((300, 1))
    targets = np.concatenate([rng.standard_normal(300), np.full(100, -5.0)])
    keep = choose_window(features, targets, 160)
    at_first = keep[keep < 250]
    assert len(at_first) > 50
    mean = targets[at_first].mean()
    print("mean of the kept at the first place", mean, "of", len(at_first))
    assert abs(mean) < 3.0 / np.sqrt(len(at_first))


def test_coincident_points_do_not_repeat():
    keep = choose_window(np.zeros((50, 3)), np.zeros(50), 20)
    assert len(set(keep.tolist())) == 20
