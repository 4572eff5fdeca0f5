"""A coupled hand: both jaws touch at one position, wherever the part lay between them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.transforms import inverse, transform
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.quality.wrench_space import grasp_quality
from gpis_grasp_planner.scene.bullet_evaluator import BulletEvaluator
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator

HAND = load_hand("parallel_jaw")
FRICTION = Friction(0.5, 0.5)
SETTINGS = SceneSettings()
PAD_MIDDLE = 0.127  # height over the palm frame [m]
UPPER = 0.0425


def solid(shape: trimesh.Trimesh) -> Part:
    mesh = TriangleMesh(
        np.asarray(shape.vertices, dtype=float), np.asarray(shape.faces, dtype=np.int32)
    )
    return Part("solid", mesh, np.asarray(shape.center_mass), 0.2, float(shape.volume), True)


BOX = solid(trimesh.creation.box((0.05, 0.03, 0.04)))  # 30 mm between the jaws


@pytest.fixture(scope="module")
def evaluator():
    return CompiledEvaluator(HAND, BOX, FRICTION, SETTINGS)


def palms(aside: np.ndarray) -> np.ndarray:
    """Palms whose middle between the pads is that far beside the box's, along the jaws' way."""
    at = np.stack([np.zeros_like(aside), -aside, np.full_like(aside, PAD_MIDDLE)], axis=1)
    return inverse(transform(np.broadcast_to(np.eye(3), (len(aside), 3, 3)), at))


def test_the_palm_moves_to_where_both_jaws_touch(evaluator, rng):
    aside = rng.uniform(-0.025, 0.025, 30)
    T = palms(aside)
    asked = T.copy()
    found = evaluator.attempt(T, np.zeros((30, 0)))
    np.testing.assert_array_equal(T, asked)  # the caller's poses are not touched
    assert (found.status == AttemptStatus.GRASPED).all()
    np.testing.assert_allclose(found.T_object_palm[:, 1, 3], 0.0, atol=1e-4)
    np.testing.assert_array_equal(found.T_object_palm[:, :3, :3], asked[:, :3, :3])
    np.testing.assert_array_equal(found.joints[:, 0], found.joints[:, 1])
    # half of what is left between the pads, less a gap
    way = UPPER - 0.015 - found.joints[:, 0]
    assert (way >= 0.0).all()
    assert (way < 2.0 * SETTINGS.closing_gap_m + 1e-6).all()
    # each pad's four corners (and its middle) on the box
    assert (found.n_contacts >= 8).all()
    for row in range(30):
        contacts = found.contacts(row)
        for sign, link in ((1.0, HAND.fingers[0].links[0]), (-1.0, HAND.fingers[1].links[0])):
            own = contacts.links == link
            np.testing.assert_allclose(contacts.normals_inward[own, 1], -sign, atol=1e-6)
            np.testing.assert_allclose(contacts.positions[own, 1], sign * 0.015, atol=1e-9)
            # the pad is 22 mm wide and higher than the box
            extent = np.ptp(contacts.positions[own], axis=0)
            np.testing.assert_allclose(extent[[0, 2]], [0.022, 0.04], atol=2e-3)


def test_a_second_closing_changes_nothing_and_the_quality_is_exact(evaluator):
    first = evaluator.attempt(palms(np.array([0.013])), np.zeros((1, 0)))
    again = evaluator.attempt(first.T_object_palm, np.zeros((1, 0)))
    np.testing.assert_allclose(again.T_object_palm, first.T_object_palm, atol=1e-5)
    exact = grasp_quality(first.contacts(0), BOX.center_of_mass, BOX.max_radius)
    assert exact.epsilon > 0.01
    assert first.epsilon[0] == pytest.approx(exact.epsilon, rel=0.05)


def test_a_part_that_is_too_wide_or_not_between_the_jaws(evaluator):
    wide = solid(trimesh.creation.box((0.05, 0.09, 0.04)))
    blocked = CompiledEvaluator(HAND, wide, FRICTION, SETTINGS).attempt(
        palms(np.zeros(1)), np.zeros((1, 0))
    )
    assert blocked.status[0] == AttemptStatus.PALM_COLLISION
    T = palms(np.zeros(1))
    T[0, 0, 3] += 0.1
    assert evaluator.attempt(T, np.zeros((1, 0))).status[0] == AttemptStatus.TOO_FEW_CONTACTS


def test_where_the_palm_cannot_go_there_is_no_grasp():
    """A wall stands where the other jaw would have to be when the palm is centred."""
    wall = trimesh.creation.box((0.3, 0.004, 0.2), transform(np.eye(3), [0.0, 0.065, 0.0]))
    part = solid(trimesh.util.concatenate([trimesh.creation.box((0.05, 0.03, 0.04)), wall]))
    evaluator = CompiledEvaluator(HAND, part, FRICTION, SETTINGS)
    asked = palms(np.array([-0.02, 0.0]))
    found = evaluator.attempt(asked, np.zeros((2, 0)))
    assert (found.status == AttemptStatus.PALM_COLLISION).all()


def test_agrees_with_pybullet(evaluator, rng):
    R = np.broadcast_to(np.eye(3), (12, 3, 3))
    at = np.stack(
        [rng.uniform(-0.02, 0.02, 12), rng.uniform(-0.02, 0.02, 12), PAD_MIDDLE + np.zeros(12)], 1
    )
    T = inverse(transform(R, at))
    expected = evaluator.attempt(T, np.zeros((12, 0)))
    with BulletEvaluator(HAND, BOX, FRICTION, SETTINGS) as bullet:
        found = bullet.attempt(T, np.zeros((12, 0)))
    np.testing.assert_array_equal(found.status, expected.status)
    np.testing.assert_allclose(found.T_object_palm, expected.T_object_palm, atol=1e-4)
    np.testing.assert_allclose(found.joints, expected.joints, atol=1e-4)
    # PyBullet's pairs are fewer than the patch's corners: a lower bound
    assert (found.epsilon <= 1.05 * expected.epsilon + 1e-9).all()
