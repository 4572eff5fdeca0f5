"""All inverse kinematics: round trip, every branch, limits, and what is out of reach."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arm_tables import dh_flange, random_joints
from scipy.optimize import least_squares

from gpis_grasp_planner.arm.description import load_arm
from gpis_grasp_planner.arm.inverse import ArmInverse
from gpis_grasp_planner.arm.kinematics import flange_poses
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.transforms import rotation_angle

TURN = 2.0 * np.pi


@pytest.mark.parametrize("name", ["six_axis", "seven_axis"])
def test_round_trip_within_a_millimetre_and_half_a_degree(name: str) -> None:
    arm = load_arm(name)
    inverse = ArmInverse(arm)
    T = np.array([dh_flange(name, q) for q in random_joints(name, 200, 5)])
    assert inverse.reachable(T).all()
    n = 0
    for pose in T:
        for number in range(0, len(inverse.slices), 7):
            [found] = inverse.solutions(pose[None], number)
            for q in inverse.within_limits(found):
                assert (arm.chain.joint_lower - 1e-9 <= q).all()
                assert (q <= arm.chain.joint_upper + 1e-9).all()
                at = dh_flange(name, q)
                assert np.linalg.norm(at[:3, 3] - pose[:3, 3]) < 1e-6
                assert rotation_angle(at[:3, :3], pose[:3, :3]) < 1e-6
                n += 1
    assert n > 400


def test_the_posture_that_made_a_pose_is_among_the_branches() -> None:
    inverse = ArmInverse(load_arm("six_axis"))
    for q in random_joints("six_axis", 300, 6):
        [found] = inverse.solutions(dh_flange("six_axis", q)[None])
        off = (found - q + np.pi) % TURN - np.pi
        assert np.abs(off).max(axis=1).min() < 1e-5
        assert len(found) <= 8


def test_numerical_solutions_from_many_starts_are_all_among_the_branches() -> None:
    # an independent solver finds nothing that the closed form lacks
    print("seed 7")
    rng = np.random.default_rng(7)
    arm = load_arm("six_axis")
    inverse = ArmInverse(arm)
    q = rng.uniform(-np.pi, np.pi, 6)
    pose = dh_flange("six_axis", q)
    [found] = inverse.solutions(pose[None])

    def miss(joints: np.ndarray) -> np.ndarray:
        return (flange_poses(arm.chain, joints[None])[0] - pose)[:3].ravel()

    n = 0
    for _ in range(40):
        end = least_squares(miss, rng.uniform(-np.pi, np.pi, 6), xtol=1e-14, ftol=1e-14)
        if end.cost < 1e-16:
            n += 1
            off = (found - end.x + np.pi) % TURN - np.pi
            assert np.abs(off).max(axis=1).min() < 1e-4
    assert n > 10


@pytest.mark.parametrize("name", ["six_axis", "seven_axis"])
def test_out_of_reach_has_no_solution(name: str) -> None:
    inverse = ArmInverse(load_arm(name))
    T = np.tile(np.eye(4), (20, 1, 1))
    T[:, 0, 3] = np.linspace(1.0, 5.0, 20)
    assert not inverse.reachable(T).any()
    # within the ball of the links' lengths, beyond what wrist and elbow give: no least squares
    T[:, 0, 3] = np.linspace(0.96, 1.1, 20)
    assert all(not len(found) for found in inverse.solutions(T))


def test_limits_by_whole_turns() -> None:
    inverse = ArmInverse(load_arm("six_axis"))
    joints = np.array([[3.0, 3.0, 3.0, -3.0, 0.0, 0.0], [3.0, 3.0, 3.3, 3.0, 0.0, 0.0]])
    found = inverse.within_limits(joints)
    np.testing.assert_allclose(found[0], joints[0], atol=1e-12)
    # the elbow has half a turn either way: 3.3 is taken as 3.3 - 2 pi
    np.testing.assert_allclose(found[1, 2], 3.3 - TURN, atol=1e-12)
    # a way over the elbow's limit has no turn that holds all of it
    way = np.linspace([0, 0, 2.9, 0, 0, 0], [0, 0, 3.4, 0, 0, 0], 5)[None]
    assert np.isnan(inverse.turned(way)).any()


def test_an_arm_of_no_known_family_is_refused(tmp_path: Path) -> None:
    text = urdf_text()
    # skew every axis
    for i in range(1, 7):
        text = text.replace('<axis xyz="0 0 1" />', f'<axis xyz="0.{i} 0.3 1" />', 1)
    (tmp_path / "skew.urdf").write_text(text)
    (tmp_path / "skew.yaml").write_text("urdf: skew.urdf\nflange_link: flange\n")
    with pytest.raises(RequestError, match="of no family"):
        ArmInverse(load_arm(str(tmp_path / "skew.yaml")))


def test_seven_joints_need_a_redundant_one(tmp_path: Path) -> None:
    (tmp_path / "seven.yaml").write_text("arm: seven_axis\nredundant_joint: null\n")
    with pytest.raises(RequestError, match="has 7 joints and no redundant one"):
        ArmInverse(load_arm(str(tmp_path / "seven.yaml")))


def urdf_text() -> str:
    import gpis_grasp_planner.arm.description as module

    path = Path(module.__file__).parent / "models/six_axis/six_axis.urdf"
    return path.read_text()
