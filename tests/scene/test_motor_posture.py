"""Postures for motor angles: coupling, breakaway and the points that the optimisation looks at."""

import numpy as np
import pytest

from gpis_grasp_planner.hand.drive import joints_from_motors
from gpis_grasp_planner.hand.kinematics import link_transforms

TOLERANCE = 2e-6


def motors_for(n, rng):
    return np.column_stack([rng.uniform(0.0, np.pi, n), rng.uniform(0.0, 2.44, (n, 3))])


@pytest.fixture
def postures(scene, rng):
    def make(name, n=30):
        s = scene(name)
        T, _ = s.cleared(n, rng)
        motors = motors_for(len(T), rng)
        # the spread decides whether the open hand is free: take those that are
        free = np.array(
            [s.gaps(P, s.joints(m[:1])).min() > TOLERANCE for P, m in zip(T, motors, strict=True)]
        )
        T, motors = T[free], motors[free]
        assert len(T) > 5
        return s, T, motors, s.evaluator.postures(T, motors)

    return make


@pytest.mark.parametrize("name", ["mug", "box", "rod"])
def test_joints_follow_the_drive_with_the_inner_links_stops(postures, name):
    s, _, motors, p = postures(name)
    inner = s.hand.of_fingers(p.joints)[..., :1]
    stop = np.where(p.inner_touches, inner, np.inf)
    np.testing.assert_allclose(
        p.joints, joints_from_motors(s.hand, motors[:, :1], motors[:, 1:], stop), atol=1e-9
    )
    assert p.inner_touches.any()
    assert not p.inner_touches.all()


@pytest.mark.parametrize("name", ["mug", "box", "rod"])
def test_inner_links_never_penetrate_and_touch_where_they_say_so(postures, name):
    s, T, _, p = postures(name)
    for row in range(len(T)):
        gaps = s.gaps(T[row], p.joints[row])
        for index, finger in enumerate(s.hand.fingers):
            assert gaps[finger.inner_link] > -TOLERANCE
            if p.inner_touches[row, index, 0]:
                assert gaps[finger.inner_link] < 1e-3 + TOLERANCE


def test_points_are_the_links_nearest_surface_points(postures):
    s, T, _, p = postures("mug")
    hand = s.evaluator._hand
    for row in range(len(T)):
        T_links = T[row] @ link_transforms(s.hand, p.joints[row][None])[0]
        for index, finger in enumerate(s.hand.fingers):
            for which, link in enumerate((finger.distal_link, finger.inner_link)):
                rows = slice(hand.point_start[link], hand.point_start[link + 1])
                world = hand.points[rows] @ T_links[link][:3, :3].T + T_links[link][:3, 3]
                expected = s.evaluator.field.value(world).min()
                point = p.points[row, index, which]
                assert np.linalg.norm(world - point, axis=1).min() < 1e-12
                assert s.evaluator.field.value(point[None])[0] == pytest.approx(expected, abs=1e-9)


def test_far_from_the_object_the_coupling_alone_decides(scene, rng):
    s = scene("marble")
    T = np.tile(np.eye(4), (10, 1, 1))
    T[:, 2, 3] = 4.0
    motors = motors_for(10, rng)
    p = s.evaluator.postures(T, motors)
    assert not p.inner_touches.any()
    np.testing.assert_allclose(
        p.joints, joints_from_motors(s.hand, motors[:, :1], motors[:, 1:]), atol=1e-12
    )
