import numpy as np
import pytest

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.optimise.rprop import RpropSettings, maximise_rprop

LONG = RpropSettings(max_iterations=500, step_min=1e-9, gradient_tolerance=1e-6)


def parabola(centre, curvature):
    centre, curvature = np.asarray(centre), np.asarray(curvature)

    def function(x):
        return -0.5 * float(curvature @ (x - centre) ** 2), -curvature * (x - centre)

    return function


def test_a_badly_scaled_parabola_is_no_harder():
    result = maximise_rprop(
        parabola([1.0, -2.0, 0.3], [1.0, 100.0, 1e4]),
        np.zeros(3),
        -5 * np.ones(3),
        5 * np.ones(3),
        LONG,
    )
    assert result.converged
    np.testing.assert_allclose(result.x, [1.0, -2.0, 0.3], atol=1e-6)
    assert result.iterations < 200


def test_only_the_signs_of_the_gradient_matter():
    f = parabola([1.0, -2.0], [1.0, 30.0])
    scaled = lambda x: (f(x)[0], 7.0 * f(x)[1])  # noqa: E731
    settings = RpropSettings(max_iterations=30, gradient_tolerance=0.0)
    a = maximise_rprop(f, np.zeros(2), -5 * np.ones(2), 5 * np.ones(2), settings)
    b = maximise_rprop(scaled, np.zeros(2), -5 * np.ones(2), 5 * np.ones(2), settings)
    np.testing.assert_array_equal(a.x, b.x)


def test_an_optimum_outside_stops_at_the_bound():
    result = maximise_rprop(parabola([9.0, 0.5], [1.0, 1.0]), [0.0, 0.0], [-1, -1], [1, 1], LONG)
    assert result.converged
    np.testing.assert_allclose(result.x, [1.0, 0.5], atol=1e-6)


def test_rosenbrock_climbs_and_the_answer_is_the_best_seen():
    seen = []

    def function(x):
        value = -(100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2)
        seen.append(value)
        slope = x[1] - x[0] ** 2
        return value, np.array([400 * x[0] * slope + 2 * (1 - x[0]), -200 * slope])

    result = maximise_rprop(function, [-1.2, 1.0], [-5, -5], [5, 5], LONG)
    assert result.value == max(seen)
    assert seen[0] == pytest.approx(-24.2)
    assert result.value > -0.1
    assert result.iterations == len(seen)


def test_values_that_are_not_finite_are_never_the_answer():
    def function(x):
        return (np.nan if x[0] > 0.5 else float(x[0])), np.ones(1)

    result = maximise_rprop(function, [0.0], [-1.0], [1.0])
    assert 0.0 <= result.x[0] <= 0.5
    assert result.value == result.x[0]
    assert not result.converged or result.iterations > 1


def test_shapes_and_bounds_are_checked():
    with pytest.raises(RequestError, match="one shape"):
        maximise_rprop(parabola([0.0], [1.0]), [0.0], [1.0], [-1.0])
