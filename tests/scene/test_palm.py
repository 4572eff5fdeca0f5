"""Clearing the palm: free, touching where refined, unmoved where it was free; way back."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator

TOLERANCE = 2e-6
PARTS = ["mug", "flask", "housing", "ball", "rod", "marble"]


def clear(s, T, normals, spread, standoff=0.0):
    return s.evaluator.clear_palm(T, normals, spread, np.full(len(T), standoff))


@pytest.mark.parametrize("name", PARTS)
def test_free_hands_are_free_and_touch_where_they_were_moved(scene, name, rng):
    s = scene(name)
    n = 60
    T, normals = s.palms(n, rng)
    spread = rng.uniform(0.0, np.pi, (n, 1))
    moved, free = clear(s, T, normals, spread)
    step = np.einsum("ij,ij->i", moved[:, :3, 3] - T[:, :3, 3], normals)
    np.testing.assert_allclose(
        moved[:, :3, 3], T[:, :3, 3] + step[:, None] * normals, atol=1e-12
    )  # along the normal and nowhere else
    assert step.min() > -1e-12
    assert step.max() <= s.settings.lambda_max_m + 1e-9
    refined = []
    for row in np.flatnonzero(free):
        gap = s.gaps(moved[row], s.joints(spread[row])).min()
        assert gap > -TOLERANCE
        if step[row] > 0.0:
            refined.append(gap)
        else:
            np.testing.assert_array_equal(moved[row], T[row])
    assert free.mean() > 0.8
    assert len(refined) > 10
    near = np.array(refined) <= 2.0 * s.settings.closing_gap_m + TOLERANCE
    print(name, "refined to the gap:", near.mean())
    assert near.mean() > 0.9


def test_the_rung_before_is_in_collision(scene, rng):
    """What was skipped or passed over was not free: the first free rung is taken."""
    s = scene("mug")
    T, normals = s.palms(40, rng)
    spread = rng.uniform(0.0, np.pi, (40, 1))
    moved, free = clear(s, T, normals, spread)
    step = np.einsum("ij,ij->i", moved[:, :3, 3] - T[:, :3, 3], normals)
    unturned = np.abs(moved[:, :3, :3] - T[:, :3, :3]).max(axis=(1, 2)) < 1e-12
    delta = s.settings.lambda_step_m
    for row in np.flatnonzero(free & unturned & (step > 0.0)):
        for rung in np.arange(0.0, step[row] - 1e-9, delta):
            at = T[row].copy()
            at[:3, 3] += rung * normals[row]
            gap = s.gaps(at, s.joints(spread[row])).min()
            depth = s.evaluator.field.value(at[None, :3, 3] + 0.06 * at[:3, 2])[0]
            assert gap < TOLERANCE or depth < 0.0


def test_a_free_palm_stays_and_standoff_goes_back_from_it(scene, rng):
    s = scene("ball")
    T, normals = s.palms(20, rng)
    T[:, :3, 3] += 0.03 * normals
    spread = rng.uniform(0.0, np.pi, (20, 1))
    stays, free = clear(s, T, normals, spread)
    assert free.sum() > 10
    np.testing.assert_array_equal(stays[free], T[free])
    back, _ = clear(s, T, normals, spread, 0.02)
    np.testing.assert_allclose(back[free][:, :3, 3], (T[:, :3, 3] + 0.02 * normals)[free])


def test_turned_hands_turn_about_their_own_axis_by_whole_steps(scene, rng):
    s = scene("flask")
    T, normals = s.palms(150, rng)
    spread = rng.uniform(0.0, np.pi, (150, 1))
    short = CompiledEvaluator(
        s.hand, s.part, s.evaluator.friction, replace(s.settings, lambda_max_m=0.02)
    )
    moved, free = short.clear_palm(T, normals, spread, np.zeros(150))
    relative = np.swapaxes(T[:, :3, :3], 1, 2) @ moved[:, :3, :3]
    np.testing.assert_allclose(relative[:, 2, 2], 1.0, atol=1e-9)
    angle = np.arctan2(relative[:, 1, 0], relative[:, 0, 0])
    steps = np.rad2deg(angle) / s.settings.theta_step_deg
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert (np.abs(steps[free]) > 0.5).any()
    along = np.einsum("ij,ij->i", moved[:, :3, 3] - T[:, :3, 3], normals)
    assert along.max() <= 0.02 + 1e-9
    for row in np.flatnonzero(free):
        assert s.gaps(moved[row], s.joints(spread[row])).min() > -TOLERANCE


def test_small_objects_within_a_link_are_found(scene, rng):
    """A marble in the middle of the palm or of a finger, where no probe may be near."""
    s = scene("marble")
    for height in (0.0793, 0.07, 0.03):
        T = transform(np.eye(3), [0.0, 0.0, -height])[None]
        assert s.evaluator.attempt(T, np.zeros((1, 1))).status[0] == AttemptStatus.PALM_COLLISION
    for row in range(60):
        T = transform(np.eye(3), [*rng.uniform(-0.07, 0.07, 2), rng.uniform(-0.12, -0.02)])
        gap = s.gaps(T, s.joints(np.zeros(1))).min()
        if abs(gap) > TOLERANCE:
            status = s.evaluator.attempt(T[None], np.zeros((1, 1))).status[0]
            assert (status == AttemptStatus.PALM_COLLISION) == (gap < 0.0), row


def test_a_wall_behind_the_hand_is_no_way_back(scene, rng):
    s = scene("walled box")
    n = 200
    yaw = Rotation.from_rotvec(
        rng.uniform(0.0, 2.0 * np.pi, (n, 1)) * np.array([0.0, 0.0, 1.0])
    ).as_matrix()
    T = transform(yaw, np.column_stack([rng.uniform(-0.01, 0.01, (n, 2)), np.full(n, -0.1203)]))
    spread = rng.uniform(0.0, 1.0, (n, 1))
    rough = Friction(1.0, 1.0)
    status, epsilon = {}, {}
    for retreat in (0.0, 0.02, 0.1):
        evaluator = CompiledEvaluator(s.hand, s.part, rough, replace(s.settings, retreat_m=retreat))
        a = evaluator.attempt(T, spread)
        status[retreat], epsilon[retreat] = a.status, a.epsilon
    closed = epsilon[0.0] > 0.0
    assert closed.sum() > 3
    # the base of the hand has 44 mm of room
    np.testing.assert_array_equal(status[0.02], status[0.0])
    assert (status[0.1][closed] == AttemptStatus.NO_WAY_BACK).all()
    assert (epsilon[0.1][closed] == -1.0).all()
    np.testing.assert_array_equal(status[0.1][~closed], status[0.0][~closed])


def test_way_back_is_refused_where_the_hand_cannot_leave(scene, rng):
    s = scene("mug")
    T, spread = s.cleared(200, rng)
    strict = s.evaluator.attempt(T, spread)
    lenient = CompiledEvaluator(
        s.hand, s.part, s.evaluator.friction, replace(s.settings, retreat_m=0.0)
    ).attempt(T, spread)
    refused = strict.status == AttemptStatus.NO_WAY_BACK
    assert (lenient.status[refused] == AttemptStatus.GRASPED).all()
    assert (lenient.epsilon[refused] > 0.0).all()
    same = ~refused
    np.testing.assert_array_equal(strict.epsilon[same], lenient.epsilon[same])
    np.testing.assert_array_equal(strict.joints, lenient.joints)

    def deepest(row):
        gaps = []
        for k in range(1, 7):
            back = T[row].copy()
            back[:3, 3] -= s.settings.retreat_m * k / 6 * back[:3, 2]
            gaps.append(s.gaps(back, s.joints(spread[row])).min())
        return min(gaps)

    for row in np.flatnonzero(refused)[:10]:
        assert deepest(row) <= 0.0
    held = np.flatnonzero((strict.status == AttemptStatus.GRASPED) & (strict.epsilon > 0.0))[:40]
    depths = np.array([deepest(row) for row in held])
    print("accepted, deepest on the way back [mm]:", np.round(1e3 * np.sort(depths)[:5], 2))
    assert (depths > -TOLERANCE).mean() > 0.9
