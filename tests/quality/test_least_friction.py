"""The smallest friction: the tangent of a taper's angle, and a search over friction by HiGHS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from gpis_grasp_planner.quality.least_friction import LEAST_FRICTION, least_friction_of
from gpis_grasp_planner.quality.measure import HeldPart
from gpis_grasp_planner.quality.wrench_space import contact_wrenches, grasp_quality

ORIGIN = np.zeros(3)
AROUND = 2.0 * np.pi * np.arange(3) / 3.0
EQUATOR = np.column_stack([np.cos(AROUND), np.sin(AROUND), np.zeros(3)])


def held(contacts, edges=8) -> HeldPart:
    return HeldPart(contacts, ORIGIN, 1.0, edges, np.eye(4), np.zeros(8))


@pytest.mark.parametrize("angle_deg", [3.0, 10.0, 25.0])
def test_on_a_taper_it_is_the_tangent_of_its_angle(angle_deg: float, grasp_of) -> None:
    """Three contacts about a cone: what the normals push up, friction has to hold down."""
    t = np.deg2rad(angle_deg)
    normals = -np.cos(t) * EQUATOR + [0.0, 0.0, np.sin(t)]
    found = least_friction_of(held(grasp_of(EQUATOR, normals, 0.9), edges=256))
    assert found == pytest.approx(np.tan(t), abs=1.5e-4)
    # a pyramid lies inside its cone: it needs more, up to 1 / cos(pi / m)
    coarse = least_friction_of(held(grasp_of(EQUATOR, normals, 0.9)))
    assert np.tan(t) - 1e-4 < coarse < np.tan(t) / np.cos(np.pi / 8) + 1e-4


def test_three_contacts_about_a_sphere_hold_with_next_to_none(grasp_of) -> None:
    assert least_friction_of(held(grasp_of(EQUATOR, -EQUATOR, 0.5))) < 1e-4


def test_two_points_never_have_force_closure(grasp_of) -> None:
    """Nothing holds the part against turning about their line."""
    x = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    assert least_friction_of(held(grasp_of(x, -x, 0.8))) == np.inf


def test_all_coefficients_are_lowered_by_one_share(grasp_of) -> None:
    t = np.deg2rad(20.0)
    normals = -np.cos(t) * EQUATOR + [0.0, 0.0, np.sin(t)]
    contacts = grasp_of(EQUATOR, normals, [0.5, 0.5, 0.5])
    scaled = replace(contacts, friction=contacts.friction * 1.6)
    found = [least_friction_of(held(c)) for c in (contacts, scaled)]
    assert found[0] == pytest.approx(found[1], abs=1e-4)


def closed_by_highs(contacts, share: float) -> bool:
    """Force closure: rank 6 and a positive combination of all edges, at least 1 each."""
    W = contact_wrenches(replace(contacts, friction=share * contacts.friction), ORIGIN, 1.0)
    if np.linalg.matrix_rank(W) < 6:
        return False
    return linprog(np.zeros(len(W)), A_eq=W.T, b_eq=np.zeros(6), bounds=(1.0, None)).status == 0


def test_a_little_more_has_force_closure_and_a_little_less_has_none(random_grasps) -> None:
    n = 0
    for contacts in random_grasps(40):
        if not grasp_quality(contacts, ORIGIN, 1.0).force_closure:
            continue
        share = least_friction_of(held(contacts)) / contacts.friction.max()
        assert 0.0 < share <= 1.0
        assert closed_by_highs(contacts, min(share + 1e-3, 1.0))
        if share > 2e-3:
            assert not closed_by_highs(contacts, share - 1e-3)
            n += 1
    assert n > 3


def test_less_is_better() -> None:
    assert not LEAST_FRICTION.figure.larger_is_better
