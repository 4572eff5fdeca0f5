"""The simplex method against SciPy's HiGHS, on random and on degenerate programmes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from gpis_grasp_planner.quality.linear_programme import (
    INFEASIBLE,
    OPTIMAL,
    UNBOUNDED,
    solve,
)


def judged(A, b, c):
    """Status and value by HiGHS."""
    found = linprog(-np.asarray(c), A_eq=A, b_eq=b, bounds=(0.0, None), method="highs")
    return {0: OPTIMAL, 2: INFEASIBLE, 3: UNBOUNDED}[found.status], found.fun


@pytest.mark.parametrize("run", range(4))
def test_value_and_status_are_those_of_highs(run: int, rng: np.random.Generator) -> None:
    seen = set()
    for _ in range(100):
        m, n = rng.integers(1, 8), rng.integers(1, 40)
        A = rng.normal(size=(m, n))
        b = A @ np.maximum(rng.normal(size=n), 0.0) if rng.random() < 0.7 else rng.normal(size=m)
        c = rng.normal(size=n)
        if rng.random() < 0.5:  # bounded
            A, b = np.vstack([A, np.ones(n)]), np.append(b, rng.uniform(0.5, 2.0))
        status, value, x = solve(A, b, c)
        expected, least = judged(A, b, c)
        assert status == expected
        seen.add(status)
        if status == OPTIMAL:
            assert value == pytest.approx(-least, abs=1e-8)
            assert (x >= -1e-9).all()
            np.testing.assert_allclose(A @ x, b, atol=1e-8)
            assert c @ x == pytest.approx(value, abs=1e-8)
    assert seen == {OPTIMAL, INFEASIBLE, UNBOUNDED}


def test_beales_example_which_cycles_without_a_rule_does_not() -> None:
    """Beale, Naval Res. Logist. Q. 2 (1955): Dantzig's rule with the first of equals cycles."""
    A = np.array(
        [
            [0.25, -60.0, -1.0 / 25.0, 9.0, 1.0, 0.0, 0.0],
            [0.5, -90.0, -1.0 / 50.0, 3.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        ]
    )
    status, value, _ = solve(A, [0.0, 0.0, 1.0], [0.75, -150.0, 0.02, -6.0, 0.0, 0.0, 0.0])
    assert status == OPTIMAL
    assert value == pytest.approx(0.05, abs=1e-12)


def test_rows_that_say_the_same_twice() -> None:
    A, b = [[1.0, 1.0, 0.0], [2.0, 2.0, 0.0], [0.0, 1.0, 1.0]], [1.0, 2.0, 1.0]
    status, value, x = solve(A, b, [1.0, 0.0, 1.0])
    assert (status, value) == (OPTIMAL, pytest.approx(2.0))
    np.testing.assert_allclose(x, [1.0, 0.0, 1.0], atol=1e-12)


def test_layout_of_the_arrays_does_not_matter() -> None:
    A = np.asfortranarray(np.array([[1.0, 2.0], [0.0, 1.0]]))
    A.setflags(write=False)
    assert solve(A, np.array([3, 1]), (1, 0))[:2] == (OPTIMAL, pytest.approx(1.0))
