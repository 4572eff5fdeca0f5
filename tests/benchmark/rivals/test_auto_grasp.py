"""Auto-grasp energies by hand, and closing from a posture."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gpis_grasp_benchmark.rivals.auto_grasp import AutoGraspAnnealing, auto_grasp_energy
from gpis_grasp_benchmark.rivals.hand_states import HandStates
from gpis_grasp_benchmark.rivals.two_level import HOLDS_NOTHING, strict_energy
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.grasp.evaluator import AttemptStatus


def test_energies_of_known_attempts(oracle):
    status = [
        AttemptStatus.GRASPED,
        AttemptStatus.GRASPED,
        AttemptStatus.PALM_COLLISION,
        AttemptStatus.SELF_COLLISION,
        AttemptStatus.TOO_FEW_CONTACTS,
        AttemptStatus.NO_WAY_BACK,
    ]
    attempts = oracle.make_attempts(
        np.tile(np.eye(4), (6, 1, 1)),
        epsilon=[0.12, -1.0, 0.5, 0.5, -1.0, -1.0],
        volume=[0.02, 0.003, 1.0, 1.0, 0.0, 0.0],
        status=status,
    )
    assert_allclose(auto_grasp_energy(attempts), [-12.6, -0.09, np.inf, np.inf, 0.0, 0.0])


def test_strict_energy_knows_no_zero():
    assert strict_energy(-3.5) == -3.5
    assert strict_energy(np.inf) == np.inf
    assert strict_energy(0.0) == HOLDS_NOTHING == 1e8


class ClosesOnly:
    """An evaluator of open hands."""

    friction = None
    n_attempts = 0

    def attempt(self, T_object_palm, spread):
        raise AssertionError

    def clear_palm(self, T_object_palm, normals_outward, spread, standoff):
        raise AssertionError


def test_an_evaluator_without_postures_is_refused(box, make_context):
    with pytest.raises(RequestError, match="ClosesOnly"):
        AutoGraspAnnealing(make_context(box, evaluator=ClosesOnly()))


def test_closing_from_an_open_posture_is_the_plain_attempt(box, make_context, random_states, rng):
    context = make_context(box)
    states = random_states(context, rng, 60)
    states[:, 7] = -4.0
    T, joints = HandStates(context).hands(states)
    spread = HandStates(context).motors(states)[:, :1]
    plain = context.evaluator.attempt(T, spread)
    start = context.evaluator.attempt_from(T, joints)
    assert context.evaluator.n_attempts == 120
    assert_allclose(start.preshape, spread)
    assert_allclose(start.start_joints, joints)
    assert plain.start_joints is None
    # Open fingers beside each other may already meet; the plain attempt does not look.
    same = start.status != AttemptStatus.SELF_COLLISION
    assert same.sum() > 30
    for name in ("status", "joints", "n_contacts", "epsilon", "volume"):
        assert_allclose(getattr(start, name)[same], getattr(plain, name)[same], atol=1e-12)


def test_fingers_only_close(box, make_context, random_states, rng):
    context = make_context(box)
    T, joints = HandStates(context).hands(random_states(context, rng, 500))
    attempts = context.evaluator.attempt_from(T, joints)
    closed = np.isin(attempts.status, (AttemptStatus.GRASPED, AttemptStatus.NO_WAY_BACK))
    assert closed.sum() > 20
    for finger in context.hand.fingers:
        inner, distal = finger.inner_joint, finger.distal_joint
        touching = np.isin(attempts.links, (finger.inner_link, finger.distal_link))
        counted = np.arange(attempts.links.shape[1]) < attempts.n_contacts[:, None]
        rows = closed & (touching & counted).any(axis=1)
        assert rows.any()
        assert np.all(attempts.joints[rows, inner] >= joints[rows, inner] - 1e-9)
        assert np.all(attempts.joints[rows, distal] >= joints[rows, distal] - 1e-9)


def test_approach_stops_at_contact_or_at_its_reach(box, make_context, random_states, rng, oracle):
    context = make_context(box)
    states = HandStates(context)
    T, joints = states.hands(random_states(context, rng, 480))
    legal = np.isfinite(context.evaluator.guided_potential(T, joints))
    T, joints = T[legal], joints[legal]
    moved, palm_touches = context.evaluator.approach(T, joints, 0.03)
    assert_allclose(moved[:, :3, :3], T[:, :3, :3])
    shift = moved[:, :3, 3] - T[:, :3, 3]
    along = np.sum(shift * T[:, :3, 2], axis=1)
    assert_allclose(shift, along[:, None] * T[:, :3, 2], atol=1e-12)
    assert np.all((along >= 0.0) & (along <= 0.03 + 1e-12))
    stopped = along < 0.03 - 1e-9
    assert 5 < stopped.sum() < len(T)
    # Free where it stopped, and in contact there: a little farther is a collision, unless the
    # link only grazes the box.
    assert np.all(np.isfinite(context.evaluator.guided_potential(moved, joints)))
    farther = moved.copy()
    farther[:, :3, 3] += 1e-3 * T[:, :3, 2]
    blocked = np.isinf(context.evaluator.guided_potential(farther, joints))
    assert np.mean(blocked[stopped]) > 0.75
    assert np.all(stopped[palm_touches] | (along[palm_touches] > 0.0299))


def test_a_palm_that_faces_the_box_comes_to_touch(box, make_context):
    context = make_context(box)
    states = np.zeros((1, 8))
    states[0, :3] = [0.0, 0.0, -0.04 - 0.02]  # the face 20 mm below the box, looking up
    states[0, 6:] = [0.0, -0.79]
    T, joints = HandStates(context).hands(states)
    moved, palm_touches = context.evaluator.approach(T, joints, 0.03)
    assert palm_touches.all()
    # F3's block stands 11 mm above the palm's face, the domed face is the highest within 1 mm.
    assert 0.005 < moved[0, 2, 3] - T[0, 2, 3] <= 0.0201
    _, touches = context.evaluator.approach(T, joints, 0.004)
    assert not touches.any()
