"""Where a hand's links go on the way to a grasp: approach, closing, and the closed hand.

Every motion is a chain of straight moves of the links' convex pieces: the approach exactly, the
closing by samples of the drive's law so dense that a link's true arc leaves the straight move
by no more than a known bow. The hull of a convex piece at both ends of a move holds all between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.drive import joints_from_motors, motors_from_joints, row_ends
from gpis_grasp_planner.hand.kinematics import link_transforms

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_STEP_RAD = 0.1
_BROKEN_AWAY_RAD = 1e-6


@dataclass(frozen=True, eq=False)
class HandPieces:
    """A hand's P convex pieces, packed; vertices are in the frame of their link.

    Attributes
    ----------
    link : (P,) int array
    start : (P + 1,) int array
        Rows of `vertices` per piece.
    vertices : (V, 3) array
    moving : (P,) bool array
        Whether the fingers' closing moves the piece.
    finger : (P,) bool array
        Whether the piece belongs to a finger (else to the palm group).
    """

    link: Index
    start: Index
    vertices: Array
    moving: NDArray[np.bool_]
    finger: NDArray[np.bool_]

    @staticmethod
    @lru_cache(maxsize=8)
    def of(hand: HandDescription) -> HandPieces:
        """Pack a hand's pieces, once per hand."""
        pieces = [
            (link, np.asarray(piece.vertices, dtype=float))
            for link, group in enumerate(hand.link_collision)
            for piece in group
        ]
        link = np.array([number for number, _ in pieces], dtype=np.int64)
        closing = {i for f in hand.fingers for i in f.links}
        return HandPieces(
            link=link,
            start=np.cumsum([0] + [len(v) for _, v in pieces]).astype(np.int64),
            vertices=np.concatenate([v for _, v in pieces]),
            moving=np.array([number in closing for number in link]),
            finger=np.array([hand.link_friction_group[number] == "finger" for number in link]),
        )


@dataclass(frozen=True, eq=False)
class HandMotions:
    """The motions of B hands, in the object's frame.

    Attributes
    ----------
    T : (B, S, L, 4, 4) array
        Poses of the links; sample 0 is the pre-grasp, the last the closed hand. Each finger has
        samples of its own, so one between is no moment in time.
    moves : (B,) int array
        Moves of the closing; a hand that needs fewer than S - 1 is at rest in the others.
    back : (B, 3) array [m]
        From the pre-grasp's place to where the approach begins.
    bow : (B,) array [m]
        How far a link's arc between samples leaves the straight move at most.
    """

    T: Array
    moves: Index
    back: Array
    bow: Array


def hand_motions(
    hand: HandDescription,
    T_object_palm: Array,
    pregrasp_joints: Array,
    joints: Array,
    back: Array,
) -> HandMotions:
    """Motions to B grasps: palms (B, 4, 4), postures (B, J) [rad], `back` (B, 3) [m].

    The fingers follow the drive's law from the pre-grasp: row after row of the closing table up to
    where the joints are held in the closed hand. A grasp's moves are its own: a batch only appends
    rest at the closed hand. Some 0.1 ms a grasp in batches.
    """
    path, moves, steps = _closing_path(hand, pregrasp_joints, joints)
    n, samples = path.shape[:2]
    T_palm_link = link_transforms(hand, path.reshape(n * samples, -1))
    T = T_object_palm[:, None, None] @ T_palm_link.reshape(n, samples, hand.n_links, 4, 4)
    # a chord of a curve with acceleration a misses it by a step^2 / 8 at most
    bow = _acceleration(hand) * steps**2 / 8.0
    return HandMotions(T, moves, np.asarray(back, dtype=float), bow)


def motions_of(hand: HandDescription, grasps: Sequence[Grasp]) -> HandMotions:
    """Motions to grasps; the approach comes from `approach_distance` back."""
    return hand_motions(
        hand,
        np.stack([g.T_object_palm for g in grasps]),
        np.stack([g.pregrasp_joints for g in grasps]),
        np.stack([g.joints for g in grasps]),
        np.stack([-g.approach_distance * g.approach_direction for g in grasps]),
    )


def shifted(T: Array, move: Array) -> Array:
    """Link poses (B, L, 4, 4) moved by (B, 3) [m]."""
    return transform(T[..., :3, :3], T[..., :3, 3] + move[:, None])


def _closing_path(hand: HandDescription, start: Array, end: Array) -> tuple[Array, Index, Array]:
    """Joints (B, S, J) from start to end (B, J), number of moves (B,), largest motor step (B,).

    Each finger divides its way in every row of the closing table by itself, whatever the others
    and the rest of the batch do. Whoever has arrived waits at the end.
    """
    _, m_start = motors_from_joints(hand, start)
    preshape, m_end = motors_from_joints(hand, end)
    ends, over, held = _held(hand, end)
    kinks = np.where(over, ends, m_end[..., None])
    kinks = np.clip(kinks, np.minimum(m_start, m_end)[..., None], m_end[..., None])
    corners = np.concatenate([m_start[..., None], kinks, m_end[..., None]], axis=-1)
    ways = np.diff(corners, axis=-1)
    step = _STEP_RAD * hand.closing_unit
    n_moves = np.ceil(np.abs(ways) / step[:, None])
    whole = np.maximum(n_moves, 1.0)
    moves = np.maximum(n_moves.sum(axis=-1).max(axis=1), 1.0)
    sample = np.arange(moves.max() + 1.0)
    at = sample[:, None]
    motors = m_start[:, None]
    for row in range(ways.shape[-1]):
        gone = at - n_moves[:, None, :, :row].sum(axis=-1)
        motors = motors + np.clip(gone / whole[:, None, :, row], 0.0, 1.0) * ways[:, None, :, row]
    n, samples = motors.shape[:2]
    path = joints_from_motors(
        hand,
        np.repeat(preshape, samples, axis=0),
        motors.reshape(n * samples, -1),
        np.repeat(held, samples, axis=0),
    ).reshape(n, samples, -1)
    path[:, 0] = start
    path = np.where((sample >= moves[:, None])[..., None], end[:, None], path)
    steps = (np.abs(ways) / whole).max(axis=-1)
    return path, moves.astype(np.int64), steps.max(axis=1)


def closing_in_time(hand: HandDescription, start: Array, end: Array, n: int) -> tuple[Array, Array]:
    """Postures of a closing hand at equal times: all motors start together, each at its speed.

    Parameters
    ----------
    hand : HandDescription
    start, end : (J,) arrays [rad]
        Pre-grasp and closed hand.
    n : int
        Number of postures, at least 2.

    Returns
    -------
    time_s : (n,) array
        From 0 to when the last motor has arrived.
    joints : (n, J) array [rad]
        By the drive's law, the first `start` and the last `end` themselves.
    """
    _, [m_start] = motors_from_joints(hand, start)
    preshape, [m_end] = motors_from_joints(hand, end)
    _, _, held = _held(hand, np.asarray(end)[None])
    way = m_end - m_start
    speed = hand.drive.motor_speed
    time_s = np.linspace(0.0, np.max(np.abs(way) / speed), n)
    gone = np.minimum(time_s[:, None] * speed, np.abs(way))
    motors = m_start + np.sign(way) * gone
    joints = joints_from_motors(
        hand, np.repeat(preshape, n, axis=0), motors, np.repeat(held, n, axis=0)
    )
    joints[0], joints[-1] = start, end
    return time_s, joints


def _held(hand: HandDescription, end: Array) -> tuple[Array, NDArray[np.bool_], Array]:
    """Where rows of the closing table end, which did, and the angles held, (B, F, D - 1) each."""
    _, m_end = motors_from_joints(hand, end)
    ends = row_ends(hand, end)
    over = (m_end[..., None] - ends) * hand.drive.first_travel[:, None] > _BROKEN_AWAY_RAD
    return ends, over, np.where(over, hand.of_fingers(end)[..., :-1], np.inf)


@lru_cache(maxsize=8)
def _acceleration(hand: HandDescription) -> float:
    """Upper bound of a finger point's acceleration per squared motor speed [m/rad^2].

    0 for a finger that slides. In each row of the closing table the joints' speeds c_j are
    constant: a point of link k turns at the sum of the first speeds about each joint, and has
    ``sum_j (c_1 + ... + c_j)^2 l_j`` at most, l_j the way from joint j to the next or to the point.
    """
    pieces = HandPieces.of(hand)
    most = 0.0
    for finger in hand.fingers:
        if hand.joint_slides[finger.inner_joint]:
            continue
        arms = [float(np.linalg.norm(hand.T_parent_joint[k][:3, 3])) for k in finger.links[1:]]
        table = finger.closing_ratio
        for row in table:
            turn = np.cumsum(row * table[0].sum() / row.sum()) ** 2
            for number, link in enumerate(finger.links):
                inwards = sum(turn[i] * arms[i] for i in range(number))
                for piece in np.flatnonzero(pieces.link == link):
                    rows = slice(pieces.start[piece], pieces.start[piece + 1])
                    radius = float(np.linalg.norm(pieces.vertices[rows], axis=1).max())
                    most = max(most, float(inwards + radius * turn[number]))
    return most
