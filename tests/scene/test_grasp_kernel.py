"""One attempt from pose to figures: status codes, determinism, figures against the exact ones."""

import numpy as np
import pytest

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.objective import EpsilonVolume
from gpis_grasp_planner.quality.wrench_space import contact_wrenches, hull_quality
from gpis_grasp_planner.scene import grasp_kernel
from gpis_grasp_planner.scene.grasp_kernel import pyramid_wrenches


def test_status_codes_are_those_of_the_interface():
    names = ("GRASPED", "PALM_COLLISION", "SELF_COLLISION", "TOO_FEW_CONTACTS", "NO_WAY_BACK")
    for name in names:
        assert getattr(grasp_kernel, name) == AttemptStatus[name]


def test_compiled_wrenches_are_those_of_the_wrench_space(scene, rng):
    obj = scene("mug").evaluator._object
    n = rng.normal(size=(12, 3))
    n[:3] = [[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]]
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    contacts = Contacts(
        rng.normal(size=(12, 3)) * 0.05, n, rng.uniform(0.1, 1, 12), np.zeros(12, dtype=np.intp)
    )
    for edges in (3, 8, 13):
        out = np.empty((12 * edges, 6))
        pyramid_wrenches(
            obj, contacts.positions, contacts.normals_inward, contacts.friction, 12, edges, out
        )
        expected = contact_wrenches(contacts, obj.center_of_mass, obj.torque_scale, edges)
        np.testing.assert_allclose(out, expected, atol=1e-13)


@pytest.mark.parametrize("name", ["mug", "flange", "ball"])
def test_epsilon_and_volume_of_attempts_against_the_exact_hull(scene, name, rng):
    s = scene(name)
    T, spread = s.cleared(90, rng)
    a = s.evaluator.attempt(T, spread)
    rows = np.flatnonzero(a.status == AttemptStatus.GRASPED)
    good = rows[np.argsort(-a.epsilon[rows])][:20]
    exact_ones, logs = 0, []
    for row in np.union1d(good, rows[:10]):
        W = contact_wrenches(a.contacts(row), s.part.center_of_mass, s.part.max_radius)
        exact = hull_quality(W)
        if abs(exact.epsilon) > 1e-6:
            assert (a.epsilon[row] > 0.0) == exact.force_closure
        assert a.epsilon[row] >= exact.epsilon - 1e-9
        exact_ones += a.epsilon[row] <= exact.epsilon + 1e-7
        if exact.volume > 1e-9:
            logs.append(np.log(a.volume[row] / exact.volume))
    total = len(np.union1d(good, rows[:10]))
    print(f"{exact_ones} of {total} exact; volume within a factor {np.exp(np.abs(logs).max()):.1f}")
    assert exact_ones >= total - 1
    assert np.median(np.abs(logs)) < np.log(3.0)


def test_far_away_and_inside_have_their_codes(scene):
    s = scene("box")
    far = transform(np.eye(3), [0.0, 0.0, 3.0])
    inside = transform(np.eye(3), [0.0, 0.0, -0.05])
    a = s.evaluator.attempt(np.stack([far, inside]), np.zeros((2, 1)))
    assert list(a.status) == [AttemptStatus.TOO_FEW_CONTACTS, AttemptStatus.PALM_COLLISION]
    np.testing.assert_array_equal(a.epsilon, -1.0)
    np.testing.assert_array_equal(a.objective(EpsilonVolume(1.0)), 0.0)


def test_finger_through_the_mugs_handle(scene):
    """A concave object: the handle's opening takes a finger, without any penetration."""
    s = scene("mug")
    field = s.evaluator.field
    grid = np.stack(
        np.meshgrid(*[np.linspace(lo, hi, 60) for lo, hi in s.part.mesh.bounds.T], indexing="ij"),
        axis=-1,
    ).reshape(-1, 3)
    # the opening: outside the solid, but within it on both sides along the handle's reach
    outside = field.value(grid) > 0.004
    reach = np.argmax(np.abs(s.part.mesh.bounds).max(axis=0))
    assert reach in (0, 1)
    far_side = grid[:, reach] > 0.5 * (s.part.mesh.bounds[1, reach] + 0.042)
    beyond = grid + np.eye(3)[reach] * 0.025
    before = grid - np.eye(3)[reach] * 0.025
    enclosed = outside & (field.value(before) < 0.006) & (field.value(beyond) < 0.006) & far_side
    found = 0
    rng = np.random.default_rng(4)
    T, spread = s.cleared(250, rng)
    a = s.evaluator.attempt(T, spread)
    assert enclosed.any()
    for row in np.flatnonzero(a.status == AttemptStatus.GRASPED):
        gaps = s.gaps(T[row], a.joints[row])
        assert gaps.min() > -2e-6
        c = a.contacts(row)
        # a contact that presses outwards on the handle's inner side
        outward = c.normals_inward[:, reach] > 0.5
        found += bool((outward & (c.positions[:, reach] > 0.05)).any())
    assert found > 0


def test_rows_are_independent_and_repeatable(scene, rng):
    s = scene("mug")
    T, spread = s.cleared(30, rng)
    all_at_once = s.evaluator.attempt(T, spread)
    again = s.evaluator.attempt(T, spread)
    order = rng.permutation(len(T))
    shuffled = s.evaluator.attempt(T[order], spread[order])
    for name in ("status", "joints", "epsilon", "volume", "n_contacts", "positions", "links"):
        np.testing.assert_array_equal(getattr(again, name), getattr(all_at_once, name))
        np.testing.assert_array_equal(getattr(shuffled, name), getattr(all_at_once, name)[order])


def test_inputs_stay_untouched_and_attempts_are_counted(scene, rng):
    s = scene("ball")
    T, normals = s.palms(5, rng)
    before, start = T.copy(), s.evaluator.n_attempts
    s.evaluator.clear_palm(T, normals, np.zeros((5, 1)), np.zeros(5))
    s.evaluator.attempt(T, np.zeros((5, 1)))
    np.testing.assert_array_equal(T, before)
    assert s.evaluator.n_attempts == start + 5


def test_an_empty_batch_is_answered_by_an_empty_batch(scene):
    s = scene("ball")
    a = s.evaluator.attempt(np.zeros((0, 4, 4)), np.zeros((0, 1)))
    assert len(a) == 0
    T, free = s.evaluator.clear_palm(
        np.zeros((0, 4, 4)), np.zeros((0, 3)), np.zeros((0, 1)), np.zeros(0)
    )
    assert len(T) == len(free) == 0


@pytest.mark.parametrize("name", ["box", "mug"])
def test_moving_the_part_moves_everything(scene, name, rng):
    """The same grasp on a part that was turned about x: figures equal but for the pyramids."""
    from scipy.spatial.transform import Rotation

    from gpis_grasp_planner.geometry.mesh import TriangleMesh
    from gpis_grasp_planner.geometry.part import Part
    from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator

    s = scene(name)
    M = transform(Rotation.from_rotvec([0.7, 0.0, 0.0]).as_matrix(), [0.1, -0.2, 0.3])
    moved_mesh = TriangleMesh(s.part.mesh.vertices @ M[:3, :3].T + M[:3, 3], s.part.mesh.faces)
    center = M[:3, :3] @ s.part.center_of_mass + M[:3, 3]
    moved = Part("moved", moved_mesh, center, s.part.mass, s.part.volume, True)
    other = CompiledEvaluator(s.hand, moved, s.evaluator.friction, s.settings)
    T, spread = s.cleared(30, rng)
    a, b = s.evaluator.attempt(T, spread), other.attempt(M @ T, spread)
    # borderline closings may differ: the fields' grids do
    same = (a.status == b.status) & (np.abs(a.joints - b.joints).max(axis=1) < 2e-3)
    assert same.mean() > 0.7
