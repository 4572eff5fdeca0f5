"""The min-weight margin: known answers, HiGHS on the programme as it is printed, invariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from gpis_grasp_planner.quality.min_weight import MIN_WEIGHT, min_weight_of
from gpis_grasp_planner.quality.wrench_space import contact_wrenches, hull_quality

ORIGIN = np.zeros(3)
AROUND = 2.0 * np.pi * np.arange(3) / 3.0
EQUATOR = np.column_stack([np.cos(AROUND), np.sin(AROUND), np.zeros(3)])


def printed(W: np.ndarray) -> float:
    """The programme with variables a and l as the paper prints it, by HiGHS; times n."""
    n = len(W)
    found = linprog(
        np.append(np.zeros(n), -1.0),
        A_ub=np.column_stack([-np.eye(n), np.ones(n)]),
        b_ub=np.zeros(n),
        A_eq=np.column_stack([np.vstack([W.T, np.ones(n)]), np.zeros(7)]),
        b_eq=np.append(np.zeros(6), 1.0),
        bounds=(None, None),
        method="highs",
    )
    return max(-n * found.fun, 0.0) if found.status == 0 else 0.0


@pytest.mark.parametrize("mu", [0.1, 0.5, 1.0])
def test_three_contacts_about_a_sphere_share_alike(mu: float, grasp_of) -> None:
    W = contact_wrenches(grasp_of(EQUATOR, -EQUATOR, mu), ORIGIN, 1.0)
    assert min_weight_of(W) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("edges", [4, 8, 16])
def test_one_finger_against_two_carries_twice_as_much(edges: int, grasp_of) -> None:
    """Along x two push against one: its edges get 1/2 in sum, theirs 1/2, so n l = 3/4."""
    p = [[-1.0, 0.4, 0.0], [-1.0, -0.4, 0.0], [1.0, 0.0, 0.0]]
    n = [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    W = contact_wrenches(grasp_of(p, n, 0.5), ORIGIN, 1.0, edges)
    assert min_weight_of(W) == pytest.approx(0.75, abs=1e-9)


def test_without_an_equilibrium_it_is_0(grasp_of) -> None:
    W = contact_wrenches(grasp_of(EQUATOR[:2], -EQUATOR[:2], 0.2), ORIGIN, 1.0)
    assert min_weight_of(W) == 0.0


def test_it_is_the_programme_of_the_paper(random_grasps) -> None:
    found = []
    for contacts in random_grasps(60):
        W = contact_wrenches(contacts, ORIGIN, 1.0)
        found.append(min_weight_of(W))
        assert found[-1] == pytest.approx(printed(W), abs=1e-7)
        closed = hull_quality(W).force_closure
        if closed:
            assert found[-1] > 0.0
        elif np.linalg.matrix_rank(W) == 6:
            assert found[-1] < 1e-7
    assert 0 < sum(value > 0.0 for value in found) < len(found)


def test_the_figure_says_what_is_better() -> None:
    assert MIN_WEIGHT.figure.name == "min_weight"
    assert MIN_WEIGHT.figure.larger_is_better
