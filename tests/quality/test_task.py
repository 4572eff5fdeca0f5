"""Task margins: friction and levers by hand, ray shooting by HiGHS, and the written form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.quality.measure import HeldPart
from gpis_grasp_planner.quality.task import Task, margin_of, read_tasks, task_measure
from gpis_grasp_planner.quality.wrench_space import contact_wrenches, hull_quality

ORIGIN = np.zeros(3)
SIDES = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
AROUND = 2.0 * np.pi * np.arange(3) / 3.0
EQUATOR = np.column_stack([np.cos(AROUND), np.sin(AROUND), np.zeros(3)])
EDGES = 8


def held(contacts, radius=1.0, edges=EDGES) -> HeldPart:
    return HeldPart(contacts, ORIGIN, radius, edges, np.eye(4), np.zeros(8))


def margin(text: str, part: HeldPart) -> float:
    return task_measure(text).of(part)


@pytest.mark.parametrize("mu", [0.2, 0.6])
def test_two_opposite_contacts_lift_by_their_friction(mu: float, grasp_of) -> None:
    """Normal forces of 1 in sum hold a weight of mu; what is pushed along them, 1."""
    part = held(grasp_of(SIDES, -SIDES, mu))
    assert margin("lift 0 0 1", part) == pytest.approx(mu, abs=1e-12)
    assert margin("lift 0 0 -3", part) == pytest.approx(mu, abs=1e-12)
    assert margin("insert 1 0 0", part) == pytest.approx(1.0, abs=1e-12)
    assert margin("insert 0 1 0 + insert 1 0 0", part) == pytest.approx(mu, abs=1e-12)
    assert margin("turn 1 0 0", part) == 0.0  # points turn freely about their line


def test_a_weight_beside_the_line_turns_the_part(grasp_of) -> None:
    """A load at a point of the line is held; one aside of it turns the part about the line."""
    part = held(grasp_of(SIDES, -SIDES, 0.5))
    assert margin("lift 0 0 1 at 0.4 0 0", part) == pytest.approx(
        # Each side holds what the lever gives it: 0.7 and 0.3 of the load, and both press alike.
        0.5 / (2.0 * 0.7),
        abs=1e-12,
    )
    assert margin("lift 0 0 1 at 0 0.2 0", part) == 0.0


@pytest.mark.parametrize("radius", [1.0, 0.04])
def test_three_contacts_turn_by_their_friction_at_their_radius(radius: float, grasp_of) -> None:
    part = held(grasp_of(radius * EQUATOR, -EQUATOR, 0.4), radius, edges=64)
    assert margin("turn 0 0 1", part) == pytest.approx(0.4, rel=2e-3)
    assert margin("turn 0 0 -1", part) == pytest.approx(0.4, rel=2e-3)
    both = margin("screw 0 0 1", part)
    assert both == pytest.approx(min(margin("turn 0 0 1", part), margin("lift 0 0 1", part)))


def test_it_is_ray_shooting_in_the_hull(rng: np.random.Generator, random_grasps) -> None:
    n = 0
    for contacts in random_grasps(40):
        W = contact_wrenches(contacts, ORIGIN, 1.0)
        load = rng.normal(size=6)
        found = margin_of(W, [load])
        judge = linprog(
            np.append(np.zeros(len(W)), -1.0),
            A_eq=np.vstack([np.column_stack([W.T, load]), np.append(np.ones(len(W)), 0.0)]),
            b_eq=np.append(np.zeros(6), 1.0),
        )
        assert found == pytest.approx(-judge.fun if judge.status == 0 else 0.0, abs=1e-8)
        quality = hull_quality(W)
        if quality.force_closure:  # no direction is nearer than the nearest facet
            assert found * np.linalg.norm(load) >= quality.epsilon - 1e-9
            n += 1
    assert n > 10


def test_a_load_is_about_the_centre_of_mass() -> None:
    task = Task("screw", (0.0, 0.0, 1.0), (0.1, 0.0, 0.0))
    force, torque = task.loads(np.array([0.0, 0.2, 0.0]), 0.5)
    np.testing.assert_allclose(force, [0, 0, -1, 0.4, 0.2, 0])  # (p - c) x f / s
    np.testing.assert_allclose(torque, [0, 0, 0, 0, 0, -1])


def test_the_written_form() -> None:
    assert read_tasks("lift 0 0 2 + insert 0 3 4 at 0.1 0 -2e-2") == (
        Task("lift", (0.0, 0.0, 1.0)),
        Task("insert", (0.0, 0.6, 0.8), (0.1, 0.0, -0.02)),
    )


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "none of lift"),
        ("hold 0 0 1", "'hold 0 0 1' begins with none of lift"),
        ("lift 0 0", "not of that form"),
        ("lift 0 0 1 at 1 2", "not of that form"),
        ("lift 0 0 x", "'x'"),
        ("lift 0 0 0", "no length"),
        ("lift 0 0 nan", "not finite"),
        ("lift 0 0 1 +", "none of lift"),
    ],
)
def test_what_is_wrong_is_named(text: str, word: str) -> None:
    with pytest.raises(RequestError, match=word) as caught:
        read_tasks(text)
    assert caught.value.code == ErrorCode.INVALID_SETTING
    assert "lift 0 0 1" in str(caught.value)
