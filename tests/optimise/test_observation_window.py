import numpy as np

from gpis_grasp_planner.optimise.observation_window import choose_window


def test_all_are_kept_where_they_fit():
    np.testing.assert_array_equal(choose_window(np.zeros((5, 2)), np.arange(5.0), 5), range(5))


def test_the_best_half_is_kept_and_the_rest_spreads():
    rng = np.random.default_rng(1)
    features = np.vstack([0.01 * rng.random((180, 2)), rng.random((20, 2))])
    targets = rng.random(200)
    keep = choose_window(features, targets, 40)
    assert len(set(keep.tolist())) == 40
    assert np.all(np.diff(keep) > 0)
    assert set(np.argsort(-targets)[:20]) <= set(keep)
    # The crowded corner is nine tenths of the points; coverage keeps nearly all of the others.
    assert np.sum(keep >= 180) >= 15


def test_coincident_points_do_not_repeat():
    keep = choose_window(np.zeros((50, 3)), np.zeros(50), 20)
    assert len(set(keep.tolist())) == 20
