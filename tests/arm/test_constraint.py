"""The arm before a part: ways that hold what they promise, refusals with their cause."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from arm_tables import dh_flange
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from gpis_grasp_planner.arm.constraint import ArmConstraint
from gpis_grasp_planner.arm.description import ArmDescription, load_arm
from gpis_grasp_planner.arm.settings import ArmSettings
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import rotation_angle, transform
from gpis_grasp_planner.grasp.arm_motion import ArmMotion
from gpis_grasp_planner.hand.description import HandDescription, load_hand
from gpis_grasp_planner.surroundings.clearance import Cause
from gpis_grasp_planner.surroundings.obstacles import BoxObstacle, SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

Array = NDArray[np.float64]
RETREAT = 0.1


@pytest.fixture(scope="module")
def hand() -> HandDescription:
    return load_hand("barrett_bh280")


def place_at(x: float, y: float, *boxes: BoxObstacle) -> Place:
    T = np.eye(4)
    T[:3, 3] = x, y, 0.02
    table = SupportPlane(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    return Place(T, Surroundings(table, boxes))


def constraint(
    arm: ArmDescription, hand: HandDescription, place: Place, **settings: float
) -> ArmConstraint:
    part = small_box()
    return ArmConstraint(arm, hand, part, place, ArmSettings(**settings), RETREAT)


def small_box() -> TriangleMesh:
    hull = ConvexHull(0.04 * np.array(list(itertools.product((-0.5, 0.5), repeat=3))))
    return TriangleMesh(hull.points, hull.simplices.astype(np.int32))


def from_above(height: float = 0.2) -> Array:
    """A palm (4, 4) over the part's origin that looks down."""
    return transform(np.diag([1.0, -1.0, -1.0]), [0.0, 0.0, height])


def postures(hand: HandDescription) -> tuple[Array, Array]:
    opened = np.zeros(len(hand.joint_names))
    return opened, opened + 0.3 * (hand.joint_upper > 0.5)


@pytest.mark.parametrize("name", ["six_axis", "seven_axis"])
def test_a_way_is_straight_and_within_the_limits(name: str, hand: HandDescription) -> None:
    arm, place = load_arm(name), place_at(0.5, 0.1)
    made = constraint(arm, hand, place)
    cause, motion = made.motion(from_above(), postures(hand))
    assert cause is None
    assert motion is not None
    check_way(motion, place.T_world_object @ from_above(), arm, name)
    assert 0.0 < motion.manipulability <= 1.0
    assert motion.worth == 0.0


def check_way(motion: ArmMotion, T_base_palm: Array, arm: ArmDescription, name: str) -> None:
    """Reached within 1 mm and 0.5 degrees at the grasp, the pre-grasp and all between."""
    np.testing.assert_array_equal(motion.approach[-1], motion.lift[0])
    for way, move in (
        (motion.approach[::-1], -RETREAT * T_base_palm[:3, 2]),
        (motion.lift, np.array([0.0, 0.0, 0.1])),
    ):
        assert (way >= arm.chain.joint_lower - 1e-9).all()
        assert (way <= arm.chain.joint_upper + 1e-9).all()
        share = np.linspace(0.0, 1.0, 10 * (len(way) - 1) + 1)
        dense = np.array([np.interp(share * (len(way) - 1), range(len(way)), q) for q in way.T]).T
        assert np.abs(np.diff(dense, axis=0)).max() < 0.05
        for part, q in zip(share, dense, strict=True):
            at = dh_flange(name, q)
            assert np.linalg.norm(at[:3, 3] - T_base_palm[:3, 3] - part * move) < 1e-3
            assert rotation_angle(at[:3, :3], T_base_palm[:3, :3]) < np.deg2rad(0.5)


def test_out_of_reach_is_known_before_and_after_the_closing(hand: HandDescription) -> None:
    made = constraint(load_arm("six_axis"), hand, place_at(1.3, 0.0))
    palm = from_above()
    assert not made.allows_palm(palm[None], postures(hand)[0][None]).any()
    assert made.motion(palm, postures(hand)) == (Cause.ARM_REACH, None)


def test_the_mask_refuses_nothing_that_the_verdict_takes(hand: HandDescription) -> None:
    print("seed 4")
    rng = np.random.default_rng(4)
    made = constraint(load_arm("six_axis"), hand, place_at(0.6, 0.2))
    taken = 0
    for _ in range(150):
        axis = rng.normal(size=3) - np.eye(3)[2]
        z = axis / np.linalg.norm(axis)
        x = np.cross(z, rng.normal(size=3))
        x /= np.linalg.norm(x)
        palm = transform(np.stack([x, np.cross(z, x), z], axis=1), -0.2 * z)
        cause, motion = made.motion(palm, postures(hand))
        free = made.allows_palm(palm[None], postures(hand)[0][None])[0]
        assert free or cause is not None
        assert (cause is None) == (motion is not None)
        taken += cause is None
    assert taken > 10


def test_an_obstacle_in_the_way_of_the_arm(hand: HandDescription) -> None:
    arm, palm = load_arm("six_axis"), from_above()
    free = constraint(arm, hand, place_at(0.5, 0.0))
    assert free.motion(palm, postures(hand))[0] is None
    # a shelf over base and elbow, clear of the hand
    pose = np.eye(4)
    pose[:3, 3] = 0.2, 0.0, 0.5
    shelf = BoxObstacle(pose, np.array([0.3, 2.0, 0.9]), "shelf")
    blocked = constraint(arm, hand, place_at(0.5, 0.0, shelf))
    assert blocked.motion(palm, postures(hand)) == (Cause.ARM_COLLISION, None)


def test_the_weight_is_what_manipulability_is_worth(hand: HandDescription) -> None:
    made = constraint(load_arm("six_axis"), hand, place_at(0.5, 0.0), manipulability_weight=0.5)
    _, motion = made.motion(from_above(), postures(hand))
    assert motion is not None
    assert motion.worth == pytest.approx(0.5 * motion.manipulability)
