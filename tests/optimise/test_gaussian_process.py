import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.optimise.distances import (
    EuclideanDistance,
    GeodesicSumDistance,
    PoseDistance,
    pose_features,
)
from gpis_grasp_planner.optimise.gaussian_process import (
    QUERY_BLOCK,
    GaussianProcess,
    GaussianProcessSettings,
)


def textbook_posterior(X, y, Q, signal, noise, scale):
    """Mean and std at Q by the plain formulas, isotropic Matern 5/2, own arithmetic."""

    def k(A, B):
        d = np.linalg.norm(A[:, None] - B[None], axis=2) / scale
        return signal * (1 + np.sqrt(5) * d + 5 / 3 * d**2) * np.exp(-np.sqrt(5) * d)

    offset, unit = y.mean(), y.std()
    z = (y - offset) / unit
    inverse = np.linalg.inv(k(X, X) + noise * np.eye(len(X)))
    mean = inverse.sum(axis=0) @ z / inverse.sum()
    posterior = mean + k(Q, X) @ inverse @ (z - mean)
    variance = signal - np.einsum("ij,jk,ik->i", k(Q, X), inverse, k(Q, X))
    return offset + unit * posterior, unit * np.sqrt(np.maximum(variance, 0))


@pytest.fixture
def data():
    rng = np.random.default_rng(11)
    X = rng.random((40, 3))
    y = 5.0 + 2.0 * np.sin(5 * X[:, 0]) + X[:, 1] ** 2 + 0.01 * rng.normal(size=40)
    return X, y, rng.random((QUERY_BLOCK + 90, 3))


def isotropic(X, y, **settings):
    process = GaussianProcess(EuclideanDistance([0] * 3), GaussianProcessSettings(**settings))
    process.fit(X, y)
    return process


def test_the_posterior_is_the_textbook_s(data):
    X, y, Q = data
    process = isotropic(X, y)
    mean, std = process.predict(Q)
    expected_mean, expected_std = textbook_posterior(
        X, y, Q, process.signal_variance, process.noise_variance, process.length_scales[0]
    )
    np.testing.assert_allclose(mean, expected_mean, atol=1e-8)
    np.testing.assert_allclose(std, expected_std, atol=1e-6)
    np.testing.assert_allclose(process.predict_mean(Q), mean, atol=1e-12)


def test_it_passes_through_the_data_and_returns_to_the_prior_far_away(data):
    X, y, _ = data
    process = isotropic(X, y, noise_std_max=1e-3)
    mean, std = process.predict(X)
    np.testing.assert_allclose(mean, y, atol=0.01)
    assert std.max() < 0.01
    far_mean, far_std = process.predict(np.full((1, 3), 1e3))
    assert far_std[0] == pytest.approx(process.target_std * np.sqrt(process.signal_variance))
    assert abs(far_mean[0] - y.mean()) < 4 * y.std()


@pytest.mark.parametrize(
    "distance",
    [EuclideanDistance(range(12), (0.1, 10.0)), PoseDistance(), GeodesicSumDistance()],
    ids=lambda d: type(d).__name__,
)
def test_the_gradient_of_the_likelihood_is_its_derivative(distance, random_poses):
    t, q = random_poses(30, 12)
    process = GaussianProcess(distance)
    process.fit(pose_features(t, q), np.sin(8 * t[:, 0]) + q[:, 0] ** 2, optimise=False)
    # At a rotation scale of 2.5 the paper's kernel has negative eigenvalues to project.
    scales = {2: [0.1, 2.5], 12: [0.7] * 12}[distance.n_scales]
    p = np.log([0.8, 0.02, *scales])
    _, gradient = process.log_likelihood(p)
    h = 1e-5
    for j in range(len(p)):
        step = h * np.eye(len(p))[j]
        difference = process.log_likelihood(p + step)[0] - process.log_likelihood(p - step)[0]
        assert gradient[j] == pytest.approx(difference / (2 * h), rel=2e-4, abs=1e-5)


def test_the_likelihood_is_the_density_of_the_targets(data):
    X, y, _ = data
    process = isotropic(X, y)
    value, _ = process.log_likelihood(process.log_parameters)
    d = np.linalg.norm(X[:, None] - X[None], axis=2) / process.length_scales[0]
    K = (1 + np.sqrt(5) * d + 5 / 3 * d**2) * np.exp(-np.sqrt(5) * d)
    C = process.signal_variance * K + process.noise_variance * np.eye(40)
    z = (y - y.mean()) / y.std()
    ones = np.ones(40)
    mean = ones @ np.linalg.solve(C, z) / (ones @ np.linalg.solve(C, ones))
    assert value == pytest.approx(multivariate_normal(mean * ones, C).logpdf(z), abs=1e-6)


def test_hyperparameters_of_a_drawn_function_come_back():
    rng = np.random.default_rng(13)
    X = rng.random((150, 2))
    true = np.array([0.15, 0.9])
    d = np.linalg.norm((X[:, None] - X[None]) / true, axis=2)
    K = (1 + np.sqrt(5) * d + 5 / 3 * d**2) * np.exp(-np.sqrt(5) * d)
    y = rng.multivariate_normal(np.zeros(150), K + 0.05**2 * np.eye(150))
    process = GaussianProcess(
        EuclideanDistance([0, 1]), GaussianProcessSettings(rprop_iterations=200, noise_std_max=0.5)
    )
    process.fit(X, y)
    assert process.length_scales == pytest.approx(true, rel=0.35)
    assert np.sqrt(process.noise_variance) * process.target_std == pytest.approx(0.05, rel=0.35)


def test_optimising_never_lowers_the_likelihood(data):
    X, y, _ = data
    process = GaussianProcess(EuclideanDistance([0, 1, 2]))
    process.fit(X, y, optimise=False)
    before = process.log_likelihood(process.log_parameters)[0]
    process.fit(X, y)
    assert process.log_likelihood(process.log_parameters)[0] > before + 1.0
    assert np.all(process.log_parameters >= process.low)
    assert np.all(process.log_parameters <= process.high)


@pytest.mark.parametrize("distance", [EuclideanDistance([0, 0, 1]), None])
def test_appending_equals_fitting_at_once(distance, data, random_poses):
    X, y, Q = data
    if distance is None:  # the indefinite kernel, which has no append of its own
        X, Q = pose_features(*random_poses(40, 1)), pose_features(*random_poses(50, 2))
        distance = GeodesicSumDistance()
    grown = GaussianProcess(distance)
    grown.fit(X[:25], y[:25])
    whole = GaussianProcess(distance)
    whole.log_parameters = grown.log_parameters.copy()
    whole.fit(X, y, optimise=False)
    grown.append(X[25:26], y[25:26])
    grown.append(X[26:], y[26:])
    for got, expected in zip(grown.predict(Q), whole.predict(Q), strict=True):
        np.testing.assert_allclose(got, expected, atol=1e-8)


def test_replacing_targets_equals_fitting_them(data):
    X, y, Q = data
    process = isotropic(X, y)
    process.replace_targets(np.cos(y) - 3.0)
    other = GaussianProcess(process.distance)
    other.log_parameters = process.log_parameters.copy()
    other.fit(X, np.cos(y) - 3.0, optimise=False)
    np.testing.assert_allclose(process.predict(Q), other.predict(Q), atol=1e-10)


def test_a_copy_leaves_the_original_alone(data):
    X, y, Q = data
    process = isotropic(X, y)
    before = process.predict(Q)
    other = process.copy()
    other.append(Q[:3], np.zeros(3))
    np.testing.assert_array_equal(process.predict(Q), before)
    assert (process.n_observations, other.n_observations) == (40, 43)
    assert other.predict(Q[:3])[1].max() < before[1][:3].max()


def test_equal_targets_and_single_observations_are_served():
    process = GaussianProcess(EuclideanDistance([0]))
    process.fit([[0.1], [0.5], [0.9]], [2.0, 2.0, 2.0])
    mean, std = process.predict([[0.3]])
    assert mean[0] == pytest.approx(2.0)
    assert np.isfinite(std[0])
    process.fit([[0.1]], [7.0])
    assert process.predict([[0.1]])[0][0] == pytest.approx(7.0)


def test_the_indefinite_kernel_predicts_finite_and_close(random_poses):
    t, q = random_poses(200, 14)
    y = np.sin(8 * t[:, 0]) + q[:, 0] ** 2
    process = GaussianProcess(GeodesicSumDistance((0.01, 1.0), (2.5, 2.5)))
    process.fit(pose_features(t[:150], q[:150]), y[:150])
    mean, std = process.predict(pose_features(t[150:], q[150:]))
    assert np.all(std >= 0)
    assert np.sqrt(np.mean((mean - y[150:]) ** 2)) < 0.6 * y.std()


def test_queries_before_data_and_bad_data_are_refused():
    process = GaussianProcess(EuclideanDistance([0, 1]))
    with pytest.raises(RequestError, match="no observations"):
        process.predict(np.zeros((1, 2)))
    with pytest.raises(RequestError, match=r"give \(n, 2\)"):
        process.fit(np.zeros((3, 1)), np.zeros(3))
    with pytest.raises(RequestError, match="NaN or infinite"):
        process.fit(np.zeros((2, 2)), [1.0, np.nan])


def test_the_noise_is_found_although_the_likelihood_sees_a_part_of_the_record():
    rng = np.random.default_rng(3)
    x = rng.random((900, 1))
    noise = 0.4
    y = np.sin(6.0 * x[:, 0]) + noise * rng.standard_normal(900)
    process = GaussianProcess(
        EuclideanDistance([0], [(0.05, 5.0)]), GaussianProcessSettings(noise_std_max=3.0)
    )
    process.fit(x, y)
    found = np.sqrt(process.noise_variance) * process.target_std
    print("noise", found)
    # 160 of 900 are looked at: 5.6 % is one standard deviation of a standard deviation.
    assert found == pytest.approx(noise, rel=0.17)
