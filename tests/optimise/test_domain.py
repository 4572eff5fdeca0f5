import numpy as np
import pytest
from scipy.stats import qmc

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.optimise.domain import BoxDomain, latin_hypercube


@pytest.fixture
def domain():
    return BoxDomain([-1.0, 0.0], [3.0, 2 * np.pi], periodic=[False, True])


def test_samples_are_a_latin_hypercube(domain):
    X = domain.sample(64, np.random.default_rng(1))
    cells = np.floor(64 * (X - domain.lower) / domain.width).astype(int)
    for column in cells.T:
        np.testing.assert_array_equal(np.sort(column), range(64))


@pytest.mark.parametrize(("n", "dim"), [(1, 1), (7, 3), (400, 4)])
def test_the_hypercube_is_that_of_scipy(n, dim, seed):
    got = latin_hypercube(n, dim, np.random.default_rng(seed))
    want = qmc.LatinHypercube(dim, rng=np.random.default_rng(seed)).random(n)
    np.testing.assert_array_equal(got, want)


def test_clipping_wraps_angles_and_cuts_the_rest(domain):
    got = domain.clip(np.array([[5.0, -0.5], [-2.0, 7.0], [0.5, 1.0]]))
    np.testing.assert_allclose(
        got, [[3.0, 2 * np.pi - 0.5], [-1.0, 7.0 - 2 * np.pi], [0.5, 1.0]], atol=1e-12
    )


def test_periodic_features_meet_at_the_seam_and_keep_small_distances(domain):
    F = domain.features(np.array([[0.0, 1e-9], [0.0, 2 * np.pi - 1e-9], [0.0, 0.1]]))
    np.testing.assert_allclose(F[0], F[1], atol=1e-9)
    # A step of 0.1 rad is 0.1 / (2 pi) of the circumference one.
    assert np.linalg.norm(F[2] - F[0]) == pytest.approx(0.1 / (2 * np.pi), rel=1e-3)
    assert domain.distance.n_scales == 2


def test_perturbations_stay_inside_and_have_the_radius(domain):
    rng = np.random.default_rng(2)
    X = np.tile([[1.0, 1.0]], (20000, 1))
    Y = domain.perturb(X, np.full(20000, 0.01), rng)
    assert np.all(Y - domain.lower >= 0)
    assert np.all(domain.upper - Y >= 0)
    step = (Y - X) / domain.width
    assert np.all(np.abs(step).sum(axis=1) > 0)
    moved = step[:, 0] != 0
    assert 0.5 < moved.mean() < 1.0
    assert step[moved, 0].std() == pytest.approx(0.01, rel=0.05)
    at_bound = domain.perturb(np.tile(domain.upper, (500, 1)), np.full(500, 0.5), rng)
    assert np.all((at_bound >= domain.lower) & (at_bound <= domain.upper))


def test_bad_boxes_are_refused():
    with pytest.raises(RequestError, match="below its upper"):
        BoxDomain([0.0, 1.0], [1.0, 1.0])
    with pytest.raises(RequestError, match="need a distance"):
        BoxDomain([0.0], [1.0], features=lambda X: X)
