"""PyBullet's evaluator against the compiled one: two closings, two collision detections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.transforms import inverse, transform
from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.scene.bullet_evaluator import BulletEvaluator
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator

FRICTION = Friction(0.6, 0.6)
SETTINGS = SceneSettings()


def shipped(mesh_id: str) -> Part:
    return MeshCatalogue([default_catalogue_directory()]).load(mesh_id)


def poses_around(part: Part, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Palms that look at the part from all sides, their faces near its middle."""
    R = Rotation.random(n, rng=rng).as_matrix()
    face = 0.079
    at = part.center_of_mass - face * R[:, :, 2] + rng.normal(scale=0.01, size=(n, 3))
    return transform(R, at), rng.uniform(0.0, np.pi, (n, 1))


def grasp_of(attempts: Attempts, row: int) -> Grasp:
    T = attempts.T_object_palm[row]
    return Grasp(
        T_object_palm=T,
        joints=attempts.joints[row],
        pregrasp_joints=np.zeros_like(attempts.joints[row]),
        contacts=attempts.contacts(row),
        quality=attempts.quality(row),
        approach_direction=T[:3, 2],
        approach_distance=0.1,
    )


@pytest.mark.parametrize("mesh_id", ["sphere", "coupling_hub"])
def test_agrees_with_the_compiled_evaluator(mesh_id: str, rng: np.random.Generator) -> None:
    part, hand = shipped(mesh_id), load_hand()
    compiled = CompiledEvaluator(hand, part, FRICTION, SETTINGS)
    T, spread = poses_around(part, 24, rng)
    outward = -T[:, :3, 2]
    T, free = compiled.clear_palm(T, outward, spread, np.zeros(len(T)))
    T, spread, outward = T[free], spread[free], outward[free]
    expected = compiled.attempt(T, spread)
    with BulletEvaluator(hand, part, FRICTION, SETTINGS) as bullet:
        found = bullet.attempt(T, spread)
        assert bullet.n_attempts == len(T) > 15
        back, also_free = bullet.clear_palm(
            T[:3] + 0.05 * transform(np.zeros((3, 3, 3)), -outward[:3]) * [[0, 0, 0, 1]],
            outward[:3], spread[:3], np.zeros(3),
        )  # fmt: skip
    same = found.status == expected.status
    assert same.mean() >= 0.9
    closed = same & (expected.status != AttemptStatus.SELF_COLLISION)
    difference = np.abs(found.joints - expected.joints).max(axis=1)[closed]
    print("largest joint differences", np.sort(difference)[-3:])
    assert (difference < 0.01).mean() > 0.95
    grasped = np.flatnonzero(same & (found.status == AttemptStatus.GRASPED))
    assert len(grasped) > 5
    links = [set(found.contacts(i).links) == set(expected.contacts(i).links) for i in grasped]
    assert np.mean(links) >= 0.8
    closure = [(found.epsilon[i] > 0) == (expected.epsilon[i] > 0) for i in grasped]
    assert np.mean(closure) >= 0.8
    assert also_free.all()
    assert np.allclose(back[:, :3, :3], T[:3, :3, :3])


def test_a_mug_keeps_its_inside_and_its_handle(rng: np.random.Generator) -> None:
    """Contacts on the inside of the wall and within the handle, which a convex mug has not."""
    part, hand = shipped("mug"), load_hand()
    compiled = CompiledEvaluator(hand, part, FRICTION, SETTINGS)
    n = 1500
    R = Rotation.random(n, rng=rng).as_matrix()
    towards = np.where(rng.random(n)[:, None] < 0.5, [[0.06, 0.0, 0.0]], [[-0.03, 0.0, 0.05]])
    T = transform(R, towards - rng.uniform(0.09, 0.15, (n, 1)) * R[:, :, 2])
    spread = rng.uniform(0.0, np.pi, (n, 1))
    attempts = compiled.attempt(T, spread)
    wall = part.mesh.bounds[1, 1]  # outer radius, the handle stands out along x
    inside, handle = [], []
    for row in np.flatnonzero(attempts.status == AttemptStatus.GRASPED):
        contacts = attempts.contacts(row)
        x, y, z = contacts.positions.T
        radius = np.hypot(x, y)
        outward = (contacts.normals_inward[:, :2] * contacts.positions[:, :2]).sum(axis=1) / radius
        if ((radius < wall - 0.001) & (outward > 0.7) & (z < part.mesh.bounds[1, 2])).any():
            inside.append(row)
        if (radius > wall + 0.005).any():
            handle.append(row)
    print(len(inside), "grasps touch the inside,", len(handle), "the handle")
    rows = np.array(inside[:5] + handle[:5])
    assert len(rows) == 10
    with BulletEvaluator(hand, part, FRICTION, SETTINGS) as bullet:
        found = bullet.attempt(T[rows], spread[rows])
    assert (found.status == AttemptStatus.GRASPED).mean() >= 0.9
    agree = np.abs(found.joints - attempts.joints[rows]).max(axis=1) < 0.01
    assert agree.mean() >= 0.9


def test_confirms_what_is_true_and_refuses_what_is_not(rng: np.random.Generator) -> None:
    part, hand = shipped("coupling_hub"), load_hand()
    compiled = CompiledEvaluator(hand, part, FRICTION, SETTINGS)
    T, spread = poses_around(part, 12, rng)
    T, free = compiled.clear_palm(T, -T[:, :3, 2], spread, np.zeros(12))
    attempts = compiled.attempt(T[free], spread[free])
    rows = np.flatnonzero(attempts.status == AttemptStatus.GRASPED)
    assert len(rows) >= 3
    grasps = [grasp_of(attempts, row) for row in rows]
    deep = [replace(g, joints=g.joints + 0.04 * (np.arange(8) > 1)) for g in grasps]
    away = [replace(g, T_object_palm=g.T_object_palm @ transform(np.eye(3), [0, 0, -0.3]))
            for g in grasps]  # fmt: skip
    assert all(inverse(g.T_object_palm)[3, 3] == 1.0 for g in grasps)
    with BulletEvaluator(hand, part, FRICTION, SETTINGS) as bullet:
        good, bad, far = (bullet.confirm(group) for group in (grasps, deep, away))
    assert all(c.contacts_confirmed and c.penetration_m < 2e-5 for c in good)
    assert all(c.penetration_m > 5e-4 and c.deepest_link is not None for c in bad)
    assert not any(c.contacts_confirmed or c.penetration_m > 0.0 for c in far)
