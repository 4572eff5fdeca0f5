"""PyBullet reads the URDF as this project does: an independent parser and kinematics."""

import numpy as np
import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient

from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.kinematics import link_transforms


@pytest.fixture
def bullet():
    client = BulletClient(connection_mode=pybullet.DIRECT)
    yield client
    client.disconnect()


def test_link_frames_masses_and_limits_agree(bullet, rng):
    hand = load_hand()
    body = bullet.loadURDF(str(hand.urdf_path))  # a fixed base would lose its mass
    infos = [bullet.getJointInfo(body, i) for i in range(bullet.getNumJoints(body))]
    link_index = {"bh_palm_link": -1} | {info[12].decode(): info[0] for info in infos}
    joint_index = {info[1].decode(): info[0] for info in infos}
    assert set(link_index) == set(hand.link_names)
    for name, mass in zip(hand.link_names, hand.link_mass, strict=True):
        assert bullet.getDynamicsInfo(body, link_index[name])[0] == pytest.approx(mass, rel=1e-9)
    for j, name in enumerate(hand.joint_names):
        lower, upper = infos[joint_index[name]][8:10]
        assert (lower, upper) == pytest.approx((hand.joint_lower[j], hand.joint_upper[j]), abs=1e-9)
    # Bullet's base frame is the palm's centre of mass: place that where P is the origin.
    local = bullet.getDynamicsInfo(body, -1)[3:5]
    bullet.resetBasePositionAndOrientation(body, *local)
    for q in rng.uniform(hand.joint_lower, hand.joint_upper, (5, 8)):
        for name, angle in zip(hand.joint_names, q, strict=True):
            bullet.resetJointState(body, joint_index[name], angle)
        T = link_transforms(hand, q)[0]
        for link, name in enumerate(hand.link_names[1:], start=1):
            state = bullet.getLinkState(body, link_index[name], computeForwardKinematics=True)
            T_bullet = from_position_quat_xyzw(state[4], state[5])
            np.testing.assert_allclose(T[link], T_bullet, atol=2e-6)


def test_every_link_has_its_collision_pieces(bullet):
    hand = load_hand()
    body = bullet.loadURDF(str(hand.urdf_path), useFixedBase=True)
    for info in [None, *(bullet.getJointInfo(body, i) for i in range(bullet.getNumJoints(body)))]:
        index, name = (-1, "bh_palm_link") if info is None else (info[0], info[12].decode())
        shapes = bullet.getCollisionShapeData(body, index)
        assert len(shapes) == len(hand.link_collision[hand.link_names.index(name)])
        assert all(shape[2] == pybullet.GEOM_MESH for shape in shapes)
