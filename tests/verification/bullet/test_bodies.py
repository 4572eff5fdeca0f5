"""Hand and part in Bullet are those of the description."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.scene.bullet_world import bullet_client
from gpis_grasp_planner.verification.bullet.bodies import (
    LINK_MARGIN_M,
    add_hand,
    add_object,
    inertia_of,
    inset,
    link_hulls,
)


def test_an_inset_polytope_has_its_faces_further_in(hand: HandDescription) -> None:
    for pieces in hand.link_collision:
        for piece in pieces:
            small = inset(piece, LINK_MARGIN_M)
            planes = ConvexHull(piece.vertices).equations
            height = (small @ planes[:, :3].T + planes[:, 3]).max(axis=0)
            assert (height <= -LINK_MARGIN_M + 1e-9).all()
            # every large face is kept
            assert np.quantile(height, 0.9) > -LINK_MARGIN_M - 1e-4


@pytest.mark.parametrize("thickness", [0.002, 0.0015, 0.0004])
def test_a_piece_thinner_than_two_margins_keeps_a_tenth_of_its_thickness(thickness: float) -> None:
    half = 0.5 * np.array([0.02, 0.03, thickness])
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    corners = inset(convex_hull(signs * half), 0.001)
    moved = 0.9 * half[2]
    np.testing.assert_allclose(np.ptp(corners, axis=0), 2.0 * (half - moved), atol=4e-5)
    assert ConvexHull(corners).volume > 0.0


def test_inertia_of_a_box(make_box: Callable[..., Part]) -> None:
    x, y, z = 0.03, 0.05, 0.11
    moments, axes = inertia_of(make_box(x, y, z))
    expected = sorted([(y * y + z * z) / 12, (x * x + z * z) / 12, (x * x + y * y) / 12])
    assert moments == pytest.approx(expected, rel=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert np.abs(axes).max(axis=0) == pytest.approx(np.ones(3))


def test_links_are_where_kinematics_puts_them(
    hand: HandDescription, rng: np.random.Generator
) -> None:
    hulls = link_hulls(hand)
    assert link_hulls(hand) is hulls
    for _ in range(3):
        joints = rng.uniform(hand.joint_lower, hand.joint_upper)
        joints[1] = joints[0]
        expected = link_transforms(hand, joints)[0]
        with bullet_client() as client:
            bodies = add_hand(client, hand, hulls, joints)
            for joint, index in bodies.joint_of.items():
                client.resetJointState(bodies.fingers, index, joints[joint])
            assert set(bodies.link_of.values()) == set(range(hand.n_links))
            for (body, index), link in bodies.link_of.items():
                if index >= 0:
                    state = client.getLinkState(body, index, computeForwardKinematics=True)
                    position, quat_xyzw = state[4], state[5]
                else:
                    position, quat_xyzw = client.getBasePositionAndOrientation(body)
                T = transform(Rotation.from_quat(quat_xyzw).as_matrix(), position)
                assert expected[link] == pytest.approx(T, abs=1e-6)


def test_a_part_of_pieces_is_where_it_should_be(make_box: Callable[..., Part]) -> None:
    """A box over a slab: the distance tells of pose and margin."""
    part = make_box(0.04, 0.06, 0.08)
    R = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    with bullet_client() as client:
        T = transform(R, [0.1, 0.2, 0.035])
        body = add_object(client, [part.mesh.vertices], part, 0.25, T)
        shape = client.createCollisionShape(client.GEOM_BOX, halfExtents=[1.0, 1.0, 0.01])
        slab = client.createMultiBody(0.0, shape, basePosition=[0.0, 0.0, -0.01])
        client.changeDynamics(slab, -1, collisionMargin=0.0)
        distance = min(row[8] for row in client.getClosestPoints(body, slab, 0.02))
        assert distance == pytest.approx(0.005, abs=5e-5)
        info = client.getDynamicsInfo(body, -1)
        assert info[0] == pytest.approx(0.25)
        assert sorted(info[2]) == pytest.approx(sorted(0.25 * inertia_of(part)[0]), rel=1e-6)
