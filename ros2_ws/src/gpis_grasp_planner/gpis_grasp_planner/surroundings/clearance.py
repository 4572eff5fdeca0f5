"""Which grasps of a part are free of the surface it stands on and of obstacles around it.

Works on finished grasps: nothing of the mesh is planned anew. Checked are the closed hand, the
open hand, the approach to it, and the closing between the two (`hand_motion`), each against
a margin. The plane is exact but for the bow of the closing (0.4 mm at most, on the safe side);
boxes and meshes are by GJK on the hulls of straight moves.

A plane costs some 0.2 ms a grasp, an obstacle about 1 ms a grasp near it; what is farther than the
balls about its and the hand's pieces can reach costs next to nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.transforms import inverse
from gpis_grasp_planner.geometry.winding import winding_numbers
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.hand_motion import HandMotions, HandPieces, motions_of, shifted
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.obstacles import (
    BoxObstacle,
    MeshObstacle,
    Obstacle,
    SupportPlane,
    Surroundings,
)
from gpis_grasp_planner.surroundings.plane_heights import lowest_heights
from gpis_grasp_planner.surroundings.sweep_distance import distances_from_tree, sweeps_to_polytope

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Cause(StrEnum):
    """What comes too near, as it is looked for; then what a request forbids; last, the arm."""

    PALM = "palm"
    FINGER = "finger"
    PREGRASP = "pre-grasp"
    CLOSING = "closing"
    APPROACH = "approach"
    DIRECTION = "approach direction"
    REGION = "forbidden region"
    ARM_REACH = "arm's reach"
    ARM_LIMITS = "arm's joint limits"
    ARM_APPROACH = "arm's straight approach"
    ARM_LIFT = "arm's straight lift"
    ARM_COLLISION = "arm's collision"


@dataclass(frozen=True)
class Clearance:
    """Whether a grasp is free of its surroundings.

    Attributes
    ----------
    distance_m : float [m]
        Smallest distance on the way up to the first phase that is blocked; 0 for an overlap with
        an obstacle, negative below a plane. Distances from obstacles are exact up to twice the
        margin and lower bounds beyond it; infinite where nothing stands around.
    cause : str or None
        None where the grasp is clear; a `Cause`, or what a user's constraint says.
    nearest : str
        Name of the support or obstacle at that distance; empty without any.
    """

    distance_m: float
    cause: str | None = None
    nearest: str = ""

    @property
    def clear(self) -> bool:
        """Whether nothing comes nearer than the margin."""
        return self.cause is None


@dataclass(frozen=True, eq=False)
class Phase:
    """Straight moves of some pieces: (B, K) moves between poses (B, K, 4, 4)."""

    cause: Cause
    piece: Index  # (K,)
    T_0: Array
    T_1: Array
    made: NDArray[np.bool_]  # (B, K), the others are no moves but rest
    bow: Array  # (B,)
    middle: Array  # (K, 3), of balls about the pieces, in their links' frames

    @cached_property
    def middles_0(self) -> Array:
        """Middles (B, K, 3) of the balls at the moves' beginning."""
        return self._middles(self.T_0)

    @cached_property
    def middles_1(self) -> Array:
        """Middles (B, K, 3) of the balls at the moves' end."""
        return self._middles(self.T_1)

    def _middles(self, T: Array) -> Array:
        turned = np.einsum("bkij,kj->bki", T[..., :3, :3], self.middle)
        return np.asarray(turned + T[..., :3, 3])


def clear_grasps(
    hand: HandDescription,
    grasps: Sequence[Grasp],
    surroundings: Surroundings,
    settings: ClearanceSettings,
) -> list[Clearance]:
    """Clearance of each grasp.

    Parameters
    ----------
    hand : HandDescription
    grasps : sequence of Grasp
        In the object's frame.
    surroundings : Surroundings
        In the object's frame (`Surroundings.seen_from`).
    settings : ClearanceSettings
    """
    if not grasps:
        return []
    return clearances(HandPieces.of(hand), motions_of(hand, grasps), surroundings, settings)


def clearances(
    pieces: HandPieces,
    motions: HandMotions,
    surroundings: Surroundings,
    settings: ClearanceSettings,
) -> list[Clearance]:
    """Clearance of each of B motions, in the frame of the surroundings."""
    n = len(motions.T)
    distance = np.full(n, np.inf)
    nearest = np.full(n, "", dtype=object)
    cause = np.full(n, None, dtype=object)
    for phase in phases(pieces, motions):
        open_rows = np.flatnonzero([c is None for c in cause])
        bodies = [surroundings.support] if surroundings.support is not None else []
        for body in (*bodies, *surroundings.obstacles):
            d = phase_distance(pieces, phase, open_rows, body, settings.margin_m)
            closer = d < distance[open_rows]
            distance[open_rows[closer]] = d[closer]
            nearest[open_rows[closer]] = body.name
        cause[open_rows[distance[open_rows] < settings.margin_m]] = phase.cause
    return [
        Clearance(float(d), c, str(name))
        for d, c, name in zip(distance, cause, nearest, strict=True)
    ]


def phases(pieces: HandPieces, motions: HandMotions) -> list[Phase]:
    """The motions as straight moves, in the order of `Cause`."""
    T = motions.T
    palm, fingers = np.flatnonzero(~pieces.finger), np.flatnonzero(pieces.finger)
    moving = np.flatnonzero(pieces.moving)
    moves = T.shape[1] - 1
    made = np.arange(moves) < motions.moves[:, None]
    closed, opened = T[:, -1], T[:, 0]

    def still(cause: Cause, poses: Array, members: Index) -> Phase:
        at = poses[:, pieces.link[members]]
        return _moves(pieces, cause, members, at, at)

    closing = _moves(
        pieces,
        Cause.CLOSING,
        np.tile(moving, moves),
        T[:, :-1, pieces.link[moving]].reshape(len(T), -1, 4, 4),
        T[:, 1:, pieces.link[moving]].reshape(len(T), -1, 4, 4),
    )

    return [
        still(Cause.PALM, closed, palm),
        still(Cause.FINGER, closed, fingers),
        still(Cause.PREGRASP, opened, fingers),
        replace(closing, made=np.repeat(made, len(moving), axis=1), bow=motions.bow),
        approach_phase(pieces, opened, motions.back),
    ]


def approach_phase(
    pieces: HandPieces, T: Array, back: Array, members: Index | None = None
) -> Phase:
    """The approach of hands at link poses (B, L, 4, 4) from (B, 3) [m] farther back.

    Of all pieces, or of `members` (K,) only.
    """
    if members is None:
        members = np.arange(len(pieces.link))
    link = pieces.link[members]
    return _moves(pieces, Cause.APPROACH, members, shifted(T, back)[:, link], T[:, link])


def _moves(pieces: HandPieces, cause: Cause, members: Index, T_0: Array, T_1: Array) -> Phase:
    """A phase of moves (B, K) that are all made, without a bow."""
    made, zero = np.ones(T_0.shape[:2], dtype=bool), np.zeros(len(T_0))
    return Phase(cause, members, T_0, T_1, made, zero, _balls(pieces)[0][members])


def phase_distance(
    pieces: HandPieces,
    phase: Phase,
    rows: Index,
    body: SupportPlane | Obstacle,
    margin: float,
) -> Array:
    """Smallest distance (len(rows),) of a phase from a body, less the bow of its arcs."""
    T_0, T_1 = phase.T_0[rows], phase.T_1[rows]
    if not len(rows) or not len(phase.piece):
        return np.full(len(rows), np.inf)
    if isinstance(body, SupportPlane):
        height = np.minimum(
            lowest(pieces, phase.piece, T_0, body), lowest(pieces, phase.piece, T_1, body)
        )
        return np.asarray(height - phase.bow[rows])
    # beyond twice the margin a lower bound does; the bow must not take it below the margin
    limit = 2.0 * margin + phase.bow[rows] + 1e-6
    bound = np.where(phase.made[rows], _lower_bound(pieces, phase, rows, body), np.inf)
    row, member = np.nonzero(bound <= limit[:, None])
    T_body_object = inverse(body.pose)
    first, last = (np.ascontiguousarray(T_body_object @ T[row, member]) for T in (T_0, T_1))
    which = phase.piece[member]
    if isinstance(body, BoxObstacle):
        distance = np.empty(len(row))
        sweeps_to_polytope(
            pieces.vertices, pieces.start, which, first, last, limit[row], body.corners, distance
        )
    else:
        distance = distances_from_tree(body.tree, pieces, which, first, last, limit[row])
    bound[row, member] = distance
    nearest = bound.min(axis=1)
    if isinstance(body, MeshObstacle):
        nearest[_swallowed(pieces, phase, T_body_object @ T_0[:, :1], body)] = 0.0
    return np.asarray(nearest - phase.bow[rows])


def _lower_bound(pieces: HandPieces, phase: Phase, rows: Index, body: Obstacle) -> Array:
    """Lower bounds (len(rows), K) of distances: from the balls about the pieces and the body."""
    points = body.corners if isinstance(body, BoxObstacle) else body.mesh.bounds
    middle, radius = points.mean(axis=0), 0.5 * float(np.linalg.norm(np.ptp(points, axis=0)))
    c = body.pose[:3, :3] @ middle + body.pose[:3, 3]
    p, q = phase.middles_0[rows], phase.middles_1[rows]
    way = q - p  # of a ball's middle: straight
    length = np.maximum(np.einsum("bki,bki->bk", way, way), 1e-30)
    s = np.clip(np.einsum("bki,bki->bk", c - p, way) / length, 0.0, 1.0)
    gap = np.linalg.norm(p + s[..., None] * way - c, axis=-1)
    return np.asarray(np.maximum(gap - _balls(pieces)[1][phase.piece] - radius, 0.0))


@lru_cache(maxsize=8)
def _balls(pieces: HandPieces) -> tuple[Array, Array]:
    """Middles (P, 3), in the links' frames, and radii (P,) of balls about the pieces."""
    parts = np.split(pieces.vertices, pieces.start[1:-1])
    middles = np.stack([0.5 * (part.min(axis=0) + part.max(axis=0)) for part in parts])
    radii = [
        np.linalg.norm(part - middle, axis=1).max()
        for part, middle in zip(parts, middles, strict=True)
    ]
    return middles, np.array(radii)


def lowest(pieces: HandPieces, piece: Index, T: Array, plane: SupportPlane) -> Array:
    """Height (B,) [m] over a plane of the lowest vertex of pieces (K,) at poses (B, K, 4, 4)."""
    height = np.full(len(T), np.inf)
    lowest_heights(pieces.vertices, pieces.start, piece, T, plane.point, plane.normal, height)
    return height


def _swallowed(pieces: HandPieces, phase: Phase, T: Array, body: MeshObstacle) -> NDArray[np.bool_]:
    """Whether pieces lie wholly inside a closed mesh, where they are far from its surface."""
    points = pieces.vertices[pieces.start[phase.piece[0]]]
    # one point a hand does: the hand is of one piece, and its surface's crossing shows as 0
    p = T[:, 0, :3, :3] @ points + T[:, 0, :3, 3]
    low, high = body.mesh.bounds
    within = ((p > low) & (p < high)).all(axis=1)
    within[within] = np.abs(winding_numbers(body.mesh.triangles, p[within])) > 0.5
    return np.asarray(within)
