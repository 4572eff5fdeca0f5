import numpy as np
import pytest

from gpis_grasp_planner.optimise.acquisition_search import (
    AcquisitionSearchSettings,
    candidates,
    maximise_acquisition,
    polish,
    refine,
)
from gpis_grasp_planner.optimise.domain import BoxDomain

DOMAIN = BoxDomain([-2.0, 0.0, -1.0], [2.0, 2 * np.pi, 1.0], periodic=[False, True, False])
GOAL = np.array([1.3, 0.02, -1.0])  # next to the seam of the angle, and on a bound


def bowl(X):
    angle = np.abs(X[:, 1] - GOAL[1])
    angle = np.minimum(angle, 2 * np.pi - angle)
    return -((X[:, 0] - GOAL[0]) ** 2) - angle**2 - (X[:, 2] - GOAL[2]) ** 2


def test_candidates_fill_the_domain_and_crowd_around_incumbents():
    settings = AcquisitionSearchSettings(n_random=300, n_around=50, radius_start=0.01)
    incumbents = np.array([[0.5, 1.0, 0.5], [-1.0, 3.0, 0.0]])
    X = candidates(DOMAIN, incumbents, settings, np.random.default_rng(1))
    assert X.shape == (400, 3)
    assert np.all(X - DOMAIN.lower >= 0)
    assert np.all(DOMAIN.upper - X >= 0)
    for j, incumbent in enumerate(incumbents):
        around = X[300 + 50 * j : 350 + 50 * j]
        assert np.abs((around - incumbent) / DOMAIN.width).max() < 0.1
    assert len(candidates(DOMAIN, incumbents[:0], settings, np.random.default_rng(1))) == 300


def test_refinement_never_worsens_and_closes_in():
    rng = np.random.default_rng(2)
    starts = DOMAIN.sample(6, rng)
    points, values = refine(
        bowl, DOMAIN, starts, bowl(starts), AcquisitionSearchSettings(n_rounds=30), rng
    )
    np.testing.assert_allclose(values, bowl(points), atol=1e-15)
    assert np.all(values >= bowl(starts))
    assert values.max() > -0.02


def test_no_rounds_return_the_starts():
    starts = DOMAIN.sample(3, np.random.default_rng(3))
    settings = AcquisitionSearchSettings(n_rounds=0)
    points, _ = refine(bowl, DOMAIN, starts, bowl(starts), settings, np.random.default_rng(3))
    np.testing.assert_array_equal(points, starts)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("polish_iterations", [0, 20])
def test_the_maximum_is_found_across_the_seam_and_on_the_bound(seed, polish_iterations):
    settings = AcquisitionSearchSettings(polish_iterations=polish_iterations)
    x, value = maximise_acquisition(
        bowl, DOMAIN, np.zeros((0, 3)), settings, np.random.default_rng(seed)
    )
    assert value == pytest.approx(bowl(x[None])[0], abs=1e-12)
    assert value > (-1e-8 if polish_iterations else -0.01)


def test_the_polish_keeps_the_start_where_there_is_no_slope():
    def flat(X):
        return np.full(len(X), -np.inf)

    start = np.array([0.1, 0.2, 0.3])
    x, value = polish(flat, DOMAIN, start, -np.inf, 10)
    np.testing.assert_array_equal(x, start)
    assert value == -np.inf
