"""What a hand can grip between its fingers, as tables made once a hand.

A grip is a posture with the places where the hand would touch: its desired contacts
(`HandDescription.desired_contacts`) on inner and distal links, moved by the coupled fingers. Two
kinds:

- `Pinches`: two sides that face each other. A side is a finger, or several that move together and
  touch at their mean (a virtual finger); the palm is a side, too, for grasps that enclose. By its
  width a pinch is found for two surface points.
- `Triads`: three fingers' places with the sides of their triangle, by which one is found for three
  surface points.

Both are tables of inverse kinematics: which posture and which pose of the palm bring the fingers to
given points. They need not be exact, since the fingers then close until they touch.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.drive import joints_from_motors
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.search.preshape_range import PreshapeRange

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_PRESHAPES = {0: 1, 1: 9, 2: 4}  # values a motor, by the number of motors
_FEWEST_PRESHAPES = 3
_MOTORS = 12
_FACING = np.cos(np.deg2rad(35.0))  # how well both sides' normals face each other
_NARROWEST_M = 1e-3
_IDLE = 0.7  # how far fingers without a place are closed, over their travel


@dataclass(frozen=True, eq=False)
class Pinches:
    """Postures whose two sides face each other, by width.

    Attributes
    ----------
    width : (n,) array [m]
        Distance of the sides, ascending.
    middle, axis : (n, 3) arrays
        Midpoint [m] and unit direction from the first side to the second, palm frame.
    preshape : (n, S) array [rad or m]
    joints : (n, J) array [rad]
        The posture; fingers that are not of the pinch are nearly closed.
    cell : (n,) int array
        Grips of the same sides and pre-shape have the same number.
    points, normals : (n, S, 3) arrays
        The places of contact of both sides [m], and the hand's outward normals there, palm frame.
    used : (n, S) bool array
        Which of the S places a pinch has.
    """

    width: Array
    middle: Array
    axis: Array
    preshape: Array
    joints: Array
    cell: Index
    points: Array
    normals: Array
    used: NDArray[np.bool_]

    def near(self, width: float, tolerance: float) -> Index:
        """Rows whose width is within a tolerance [m]."""
        low, high = np.searchsorted(self.width, [width - tolerance, width + tolerance])
        return np.arange(low, high)


@dataclass(frozen=True, eq=False)
class Triads:
    """Postures of three fingers.

    Attributes
    ----------
    points, normals : (n, 3, 3) arrays
        Places of contact [m] and the hand's outward normals there, palm frame.
    preshape : (n, S) array [rad or m]
    joints : (n, J) array [rad]
    cell : (n,) int array
        As for `Pinches`.
    tree : cKDTree
        Over the sides (n, 3) [m] of the triangles: 0-1, 1-2, 2-0.
    """

    points: Array
    normals: Array
    preshape: Array
    joints: Array
    cell: Index
    tree: cKDTree


@dataclass(frozen=True, eq=False)
class _Places:
    """Places of contact of fingers over pre-shapes (C) and motors (M), as (C, M, K, 3)."""

    points: Array
    normals: Array
    fingers: Index


def triangle_sides(points: Array) -> Array:
    """Sides (n, 3) [m] of triangles (n, 3, 3)."""
    return np.asarray(np.linalg.norm(points - np.roll(points, -1, axis=1), axis=2))


@lru_cache(maxsize=8)
def pinches(hand: HandDescription, max_deg: float) -> Pinches:
    """All pinches of a hand (`PreshapeRange.of`); cached, some 50 ms at first."""
    preshapes, fingers, palm = _places(hand, max_deg)
    sides = [(np.array([f]), np.array([g])) for f, g in combinations(range(len(fingers)), 2)]
    if len(fingers) > 2:
        every = np.arange(len(fingers))
        sides += [(np.array([f]), np.delete(every, f)) for f in every]
    facing = [(_side(fingers, a), _side(fingers, b)) for a, b in sides]
    if palm is not None:
        facing.append((palm, _side(fingers, np.arange(len(fingers)))))
    made = [_between(hand, preshapes, a, b) for a, b in facing]
    for kind, table in enumerate(made):
        table["cell"] += kind * len(preshapes)
    n_places = max(table["points"].shape[1] for table in made)
    for table in made:
        missing = n_places - table["points"].shape[1]
        for name in ("points", "normals"):
            table[name] = np.pad(table[name], ((0, 0), (0, missing), (0, 0)))
        table["used"] = np.pad(table["used"], ((0, 0), (0, missing)))
    joined = {name: np.concatenate([table[name] for table in made]) for name in made[0]}
    order = np.argsort(joined["width"], kind="stable")
    return Pinches(**{name: values[order] for name, values in joined.items()})


@lru_cache(maxsize=8)
def triads(hand: HandDescription, max_deg: float) -> Triads | None:
    """Three fingers on their outermost places; None for a hand of fewer. Cached, some 20 ms."""
    preshapes, fingers, _ = _places(hand, max_deg)
    if len(fingers) < 3:
        return None
    points, normals, preshape, joints, cell = [], [], [], [], []
    motors = np.stack(np.meshgrid(*[np.arange(_MOTORS)] * 3, indexing="ij"), -1).reshape(-1, 3)
    for chosen in combinations(range(len(fingers)), 3):
        for place in (-1, -2):
            for s, value in enumerate(preshapes):
                of = [fingers[f] for f in chosen]
                # a finger with one place has that both times
                at = [max(place, -places.points.shape[2]) for places in of]
                p = [f.points[s, m, k] for f, m, k in zip(of, motors.T, at, strict=True)]
                n = [f.normals[s, m, k] for f, m, k in zip(of, motors.T, at, strict=True)]
                points.append(np.stack(p, axis=1))
                normals.append(np.stack(n, axis=1))
                preshape.append(np.tile(value, (len(motors), 1)))
                joints.append(
                    _joints(hand, preshape[-1], {f: motors[:, k] for k, f in enumerate(chosen)})
                )
                cell.append(np.full(len(motors), s))
    joined, outward = np.concatenate(points), np.concatenate(normals)
    inward = joined.mean(axis=1, keepdims=True) - joined
    facing = np.einsum("nij,nij->ni", inward, outward) > 0.0
    keep = facing.all(axis=1)
    return Triads(
        joined[keep],
        outward[keep],
        np.concatenate(preshape)[keep],
        np.concatenate(joints)[keep],
        np.concatenate(cell)[keep],
        cKDTree(triangle_sides(joined[keep])),
    )


def _motors(hand: HandDescription) -> Array:
    """Angles (M, F) [rad] of the finger motors that the tables look at."""
    low, high = hand.drive.motor_lower, hand.drive.motor_upper
    return np.asarray(low + np.linspace(0.0, 1.0, _MOTORS)[:, None] * (high - low))


def _joints(hand: HandDescription, preshape: Array, steps: Mapping[int, Index]) -> Array:
    """Postures (n, J) [rad]: fingers with their motor at steps (n,), the others nearly closed."""
    motors = _motors(hand)
    chosen = np.tile(_IDLE * motors[-1], (len(preshape), 1))
    for finger, step in steps.items():
        chosen[:, finger] = motors[step, finger]
    return joints_from_motors(hand, preshape, chosen)


def _places(hand: HandDescription, max_deg: float) -> tuple[Array, list[_Places], _Places | None]:
    """Pre-shapes (C, S), the places of each finger, and the palm's if it has any."""
    wanted = hand.desired_contacts
    values = _PRESHAPES.get(len(hand.preshape), _FEWEST_PRESHAPES)
    preshapes = PreshapeRange.of(hand, max_deg).grid(values)
    preshape = np.repeat(preshapes, _MOTORS, axis=0)
    motors = np.tile(_motors(hand), (len(preshapes), 1))
    T = link_transforms(hand, joints_from_motors(hand, preshape, motors))
    T = T[:, wanted.links]
    points = np.einsum("bkij,kj->bki", T[:, :, :3, :3], wanted.points) + T[:, :, :3, 3]
    normals = np.einsum("bkij,kj->bki", T[:, :, :3, :3], wanted.normals)
    points, normals = (x.reshape(len(preshapes), _MOTORS, -1, 3) for x in (points, normals))
    fingers = []
    for number, finger in enumerate(hand.fingers):
        own = np.isin(wanted.links, finger.links)
        fingers.append(_Places(points[:, :, own], normals[:, :, own], np.array([number])))
    on_palm = wanted.links == hand.link_names.index(hand.palm_link)
    if not on_palm.any():
        return preshapes, fingers, None
    middle = [x[:, :1, on_palm].mean(axis=2, keepdims=True) for x in (points, normals)]
    none = np.array([], dtype=np.intp)
    return preshapes, fingers, _Places(middle[0][:, :, None], _unit(middle[1])[:, :, None], none)


def _side(fingers: list[_Places], chosen: Index) -> _Places:
    """Fingers that move together, their places in a further axis (C, M, K, n, 3).

    Of fingers that differ in their number of places the outermost that all of them have.
    """
    k = min(fingers[f].points.shape[2] for f in chosen)
    return _Places(
        np.stack([fingers[f].points[:, :, -k:] for f in chosen], axis=3),
        np.stack([fingers[f].normals[:, :, -k:] for f in chosen], axis=3),
        chosen,
    )


def _between(
    hand: HandDescription, preshapes: Array, first: _Places, second: _Places
) -> dict[str, NDArray[Any]]:
    """Columns of `Pinches` for two sides (C, M, K, n, 3) that face each other."""
    a, b = first.points.mean(axis=3), second.points.mean(axis=3)
    na, nb = _unit(first.normals.mean(axis=3)), _unit(second.normals.mean(axis=3))
    s, m, k = a.shape[:3]
    way = b.reshape(s, 1, -1, 3) - a.reshape(s, m * k, 1, 3)
    width = np.linalg.norm(way, axis=-1)
    axis = way / np.maximum(width, 1e-12)[..., None]
    faces = np.einsum("sabi,sai->sab", axis, na.reshape(s, m * k, 3)) > _FACING
    faces &= np.einsum("sabi,sbi->sab", axis, nb.reshape(s, -1, 3)) < -_FACING
    if hand.drive.coupled:  # one motor: both sides at the same step
        step = np.arange(m * k) // k
        faces &= step[:, None] == step
    i, p, q = np.nonzero(faces & (width > _NARROWEST_M))
    firsts = [x.reshape(s, m * k, -1, 3)[i, p] for x in (first.points, first.normals)]
    seconds = [x.reshape(s, -1, x.shape[3], 3)[i, q] for x in (second.points, second.normals)]
    points = np.concatenate([firsts[0], seconds[0]], axis=1)
    middle = 0.5 * (a.reshape(s, -1, 3)[i, p] + b.reshape(s, -1, 3)[i, q])
    steps = {int(f): p // k for f in first.fingers}
    steps |= {int(f): q // b.shape[2] for f in second.fingers}
    return {
        "width": width[i, p, q],
        "middle": middle,
        "axis": axis[i, p, q],
        "preshape": preshapes[i],
        "joints": _joints(hand, preshapes[i], steps),
        "cell": i,
        "points": points,
        "normals": np.concatenate([firsts[1], seconds[1]], axis=1),
        "used": np.ones(points.shape[:2], dtype=bool),
    }


def _unit(vectors: Array) -> Array:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-12))
