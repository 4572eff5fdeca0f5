"""The closing hand's own forces: known answers, an independent programme, properties."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.hand.description import HandDescription, load_hand
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.quality.closing_balance import (
    ClosingBalance,
    least_squares,
    tip_arms,
)

PRESS_N, HOLD_N, LOAD_N = 15.0, 20.0, 1.5
SCALE_M = 0.05


@pytest.fixture(scope="module")
def hand() -> HandDescription:
    return load_hand()


def tips(hand: HandDescription, joints: np.ndarray) -> np.ndarray:
    """Where the fingertips are in the palm frame (F, 3)."""
    poses = link_transforms(hand, joints)[0]
    return np.array(
        [
            poses[f.distal_link, :3, :3] @ f.tip_point + poses[f.distal_link, :3, 3]
            for f in hand.fingers
        ]
    )


def closed(hand: HandDescription, inner: float) -> np.ndarray:
    """All fingers with their coupling at one angle, no spread."""
    joints = np.zeros(hand.n_joints)
    for finger in hand.fingers:
        joints[finger.inner_joint] = inner
        joints[finger.distal_joint] = finger.closing_ratio[0, 1] * inner
    return joints


def imbalance_of(
    hand: HandDescription,
    joints: np.ndarray,
    at: np.ndarray,
    normals: np.ndarray,
    links: list[int],
    friction: float = 0.6,
    T: np.ndarray | None = None,
    share: float = 1.0,
    **forces: float,
) -> float:
    """Imbalance of one hand with contacts in the palm frame, the part's centre between them."""
    T = np.eye(4) if T is None else T
    positions = at @ T[:3, :3].T + T[:3, 3]
    balance = ClosingBalance(
        hand,
        positions.mean(axis=0),
        SCALE_M,
        share,
        forces.get("press_n", PRESS_N),
        forces.get("hold_n", HOLD_N),
        forces.get("load_n", LOAD_N),
    )
    k = len(at)
    return float(
        balance.imbalance(
            T[None],
            joints[None],
            np.array([k]),
            positions[None],
            (normals @ T[:3, :3].T)[None],
            np.full((1, k), friction),
            np.array([links]),
        )[0]
    )


def three_tips(hand: HandDescription) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """F1 and F2 against F3, normals along the palm's y: what a box between the tips would give."""
    joints = closed(hand, 1.2)
    at = tips(hand, joints)
    toward = np.sign(at[:, 1].mean() - at[:, 1])
    normals = np.column_stack([np.zeros(3), toward, np.zeros(3)])
    return at, normals, [finger.distal_link for finger in hand.fingers]


def test_two_against_one_balance_where_the_gears_of_the_one_hold(hand: HandDescription) -> None:
    """Each of two presses with P; the third has to resist both, and is driven back before that."""
    at, normals, links = three_tips(hand)
    joints = closed(hand, 1.2)
    at[:, 2] = at[:, 2].mean()
    strong = imbalance_of(hand, joints, at, normals, links, hold_n=60.0)
    weak = imbalance_of(hand, joints, at, normals, links, hold_n=15.0)
    print(strong, weak)
    assert strong == pytest.approx(0.0, abs=1e-6)
    assert weak > 1.0


def test_a_lone_finger_pushes_with_its_force(hand: HandDescription) -> None:
    """One frictionless contact: nothing opposes it, and least is left where it presses least.

    The torque about the inner joint is `press * arm`, so the force is that over the lever of the
    normal; a push along it adds to it in full. Bounds may give way by a little.
    """
    at, normals, links = three_tips(hand)
    joints = closed(hand, 1.2)
    finger = hand.fingers[2]
    T = link_transforms(hand, joints)[0, finger.inner_link]
    lever = np.cross(at[2] - T[:3, 3], normals[2]) @ (
        T[:3, :3] @ hand.joint_axis[finger.inner_link]
    )
    force = PRESS_N * tip_arms(hand, 2)[0] / lever
    assert force > 0.0
    found = imbalance_of(hand, joints, at[2:], normals[2:], links[2:], friction=0.0)
    assert found * LOAD_N == pytest.approx(force + LOAD_N, rel=0.02)


def test_friction_decides_where_two_tips_oppose_aslant(hand: HandDescription) -> None:
    """Normals a degrees off the line between two contacts need friction of tan(a)."""
    joints = closed(hand, 1.2)
    at, normals, links = three_tips(hand)
    at[:, [0, 2]] = at[:1, [0, 2]]
    pair, angle = [0, 2], np.radians(25.0)
    tilted = np.stack(
        [
            Rotation.from_rotvec(sign * angle * np.array([1.0, 0.0, 0.0])).apply(normals[i])
            for i, sign in zip(pair, (1.0, -1.0), strict=True)
        ]
    )
    both = [links[i] for i in pair]
    values = {
        mu: imbalance_of(hand, joints, at[pair], tilted, both, friction=mu, load_n=1e-3)
        * 1e-3
        / PRESS_N
        for mu in (0.2, 0.4, 0.47, 0.6)
    }
    print(np.tan(angle), values)
    assert values[0.2] > values[0.4] > 0.01
    assert values[0.6] < 1e-6


def test_an_independent_programme_says_the_same(hand: HandDescription) -> None:
    """Random contacts on random links, against SciPy's non-negative least squares."""
    rng = np.random.default_rng(7)
    print("seed 7")
    worst = 0.0
    for _ in range(200):
        m, n = int(rng.integers(6, 19)), int(rng.integers(10, 190))
        M = rng.normal(size=(m, n)) + rng.normal(size=(m, 1))
        M[:, n // 2 :] *= 20.0
        b = rng.normal(size=m) * rng.choice([0.1, 1.0, 30.0])
        x = np.zeros(n)
        residual, _ = least_squares(M, b, x, np.zeros(m, dtype=np.int64), 0)
        expected = nnls(M, b, maxiter=5000)[1]
        assert (x >= 0.0).all()
        assert residual == pytest.approx(np.linalg.norm(M @ x - b), abs=1e-9)
        worst = max(worst, abs(residual - expected) / (1.0 + np.linalg.norm(b)))
    print("worst", worst)
    assert worst < 1e-6


def test_a_solution_is_where_the_next_search_starts(hand: HandDescription) -> None:
    rng = np.random.default_rng(3)
    M, passive = rng.normal(size=(12, 60)), np.zeros(12, dtype=np.int64)
    x, n_passive = np.zeros(60), 0
    for _ in range(20):
        b = rng.normal(size=12)
        residual, n_passive = least_squares(M, b, x, passive, n_passive)
        assert residual == pytest.approx(nnls(M, b, maxiter=5000)[1], abs=1e-8)
        assert sorted(passive[:n_passive]) == sorted(np.flatnonzero(x))


def test_nothing_depends_on_the_frame_of_the_part(hand: HandDescription) -> None:
    at, normals, links = three_tips(hand)
    joints = closed(hand, 1.2)
    rng = np.random.default_rng(11)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = Rotation.random(random_state=11).as_matrix(), rng.normal(size=3)
    plain = imbalance_of(hand, joints, at, normals, links)
    # the pyramids turn with the tangents, so that they are not quite the same cones
    assert imbalance_of(hand, joints, at, normals, links, T=T) == pytest.approx(plain, rel=0.1)


def test_more_friction_and_more_hold_never_leave_more(hand: HandDescription) -> None:
    at, normals, links = three_tips(hand)
    joints = closed(hand, 1.2)
    by_friction = [imbalance_of(hand, joints, at, normals, links, mu) for mu in (0.1, 0.3, 0.9)]
    by_hold = [
        imbalance_of(hand, joints, at, normals, links, hold_n=hold) for hold in (15.0, 20.0, 40.0)
    ]
    assert by_friction == sorted(by_friction, reverse=True)
    assert by_hold == sorted(by_hold, reverse=True)


def test_no_hand_no_figures(hand: HandDescription) -> None:
    balance = ClosingBalance(hand, np.zeros(3), SCALE_M, 1.0, PRESS_N, HOLD_N, LOAD_N)
    rows, counts = np.zeros((0, 4)), np.zeros(0, dtype=np.int64)
    none = balance.imbalance(
        np.zeros((0, 4, 4)), np.zeros((0, hand.n_joints)), counts,
        np.zeros((0, 4, 3)), np.zeros((0, 4, 3)), rows, rows.astype(np.int64),
    )  # fmt: skip
    assert none.shape == (0,)
