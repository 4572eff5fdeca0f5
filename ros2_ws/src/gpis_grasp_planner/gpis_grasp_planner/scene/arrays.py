"""Hand and object as flat arrays, the form in which the compiled loops take them."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gpis_grasp_planner.compiled_cache import contents, write_kept
from gpis_grasp_planner.disk_cache import code_version
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.finger import Finger
from gpis_grasp_planner.hand.surface_points import SurfacePoints, surface_points
from gpis_grasp_planner.packed_arrays import pack, unpack

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_PROBES = 48
_PROBE_PITCH = 0.002


class HandArrays(NamedTuple):
    """A hand of L links, P convex pieces, N surface points, F fingers of D links, K probes a link.

    A finger of fewer links than D has its own from `first` on; what is before is never looked at.

    `piece_*`, `point_*` and `probe*` are in the frame of their link. Probes are few points all
    over a link's surface, for quick looks at the distance field. `probe_reach` is how far a
    finger link's probe is from the axis of each of its finger's joints at most, or 1 where that
    joint slides: its speed per unit of the joint's motion. How a finger closes is a table
    (`scene.closing`).
    """

    parent: Index  # (L,)
    joint: Index  # (L,) -1: fixed
    R_parent_joint: Array  # (L, 3, 3)
    t_parent_joint: Array  # (L, 3)
    axis: Array  # (L, 3)
    slides: NDArray[np.bool_]  # (L,) the link's joint is prismatic
    piece_link: Index  # (P,)
    piece_start: Index  # (P + 1,)
    piece_vertices: Array  # (V, 3)
    piece_lower: Array  # (P, 3)
    piece_upper: Array  # (P, 3)
    link_piece_start: Index  # (L + 1,)
    point_start: Index  # (L + 1,)
    points: Array  # (N, 3)
    point_normals: Array  # (N, 3)
    probes: Array  # (L, K, 3)
    probe_reach: Array  # (L, K, D)
    link_middle: Array  # (L, 3) of the box about a link's probes, in its frame
    link_radius: Array  # (L,) of the ball about that which holds the probes
    link_cover: Array  # (L,) farthest place of the link's surface from its nearest probe
    link_reach: Array  # (L, D) the largest `probe_reach` that any point of the link has
    preshape_joints: Index  # (H,)
    preshape_gain: Array  # (S, H) their motion per motor's of the pre-shape
    first: Index  # (F,)
    finger_joint: Index  # (F, D)
    finger_link: Index  # (F, D)
    finger_upper: Array  # (F, D) the joints' upper limits; a coupled finger's twice that
    finger_unit: Array  # (F,) what counts as 1 rad of the closing, `HandDescription.closing_unit`
    closing_ratio: Array  # (F, D, D) [f, h, k]: joint k's motion per joint h's in row h
    row_gear: Array  # (F, D) the motor's motion per joint h's in row h
    row_start: Array  # (F, D, D) [f, h, k]: where joint k is when row h begins after stops alone
    advances_at_stop: bool  # a joint at its stop is held, and the next row goes on
    coupled: bool  # the fingers move together, by one motor
    open_links: Index  # links that the fingers' closing does not move
    link_is_palm: NDArray[np.bool_]  # (L,) friction group
    link_is_pad: NDArray[np.bool_]  # (L,) touches with a flat patch (`scene.touch`)
    link_finger: Index  # (L,) finger that moves the link by closing, or -1
    n_joints: int


class ObjectArrays(NamedTuple):
    """An object: distance field, triangle tree, and what its wrenches need."""

    field: NDArray[np.float32]
    origin: Array
    spacing: float
    triangles: Array
    normals: Array
    lower: Array
    upper: Array
    child: Index
    slabs: Array
    center_of_mass: Array
    torque_scale: float
    friction_finger: float
    friction_palm: float


@lru_cache(maxsize=8)
def hand_arrays(hand: HandDescription) -> HandArrays:
    """Pack a hand, once: 0.5 s, or 5 ms where that lies on disk beside the compiled code.

    The arrays are shared; do not write to them.
    """
    name = f"hand-{hand.yaml_path.stem}-{hand_key(hand, 'scene/arrays.py')}.arrays"
    for content in contents(name):
        with contextlib.suppress(ValueError):  # damaged: made and written anew
            return _unpacked(unpack(bytearray(content)))
    content = pack(_packed_hand(hand)._asdict())
    write_kept(name, content)
    # Not the arrays as they were made: some are read-only, for which all would be compiled again.
    return _unpacked(unpack(bytearray(content)))


def kept_surface_points(hand: HandDescription) -> SurfacePoints:
    """As `surface_points` with its own spacings, from where the arrays lie (0.2 s less)."""
    arrays = hand_arrays(hand)
    links = np.repeat(np.arange(hand.n_links), np.diff(arrays.point_start))
    return SurfacePoints(arrays.points, arrays.point_normals, links, arrays.point_start)


def hand_key(hand: HandDescription, *sources: str) -> str:
    """Hash of the hand's files and of the code that makes something of them."""
    version = code_version("geometry", "hand", *sources)
    return hashlib.sha256((version + hand.digest).encode()).hexdigest()[:16]


def _unpacked(arrays: Mapping[str, NDArray[Any]]) -> HandArrays:
    """Numbers come back as arrays without dimensions."""
    values: dict[str, Any] = {n: a if a.ndim else a.item() for n, a in arrays.items()}
    return HandArrays(**values)


def _packed_hand(hand: HandDescription) -> HandArrays:
    n_links = hand.n_links
    vertices, lower, upper, piece_link = [], [], [], []
    link_piece_start = np.zeros(n_links + 1, dtype=np.int64)
    for link in range(n_links):
        for piece in hand.link_collision[link]:
            vertices.append(np.asarray(piece.vertices, dtype=float))
            lower.append(piece.vertices.min(axis=0))
            upper.append(piece.vertices.max(axis=0))
            piece_link.append(link)
        link_piece_start[link + 1] = len(piece_link)
    samples = surface_points(hand)
    point_start = np.asarray(samples.offsets, dtype=np.int64)
    points = np.array(samples.points)
    axis = np.asarray(hand.joint_axis, dtype=float)
    probes, link_cover = _probes_of(hand)
    link_middle = 0.5 * (probes.min(axis=1) + probes.max(axis=1))
    from_middle = np.linalg.norm(probes - link_middle[:, None], axis=2)
    link_finger = np.full(n_links, -1, dtype=np.int64)
    n_of_finger = hand.drive.n_links
    probe_reach = np.zeros((n_links, probes.shape[1], n_of_finger))
    link_reach = np.zeros((n_links, n_of_finger))
    for index, finger in enumerate(hand.fingers):
        for k, link in enumerate(finger.links):
            link_finger[link] = index
            a, b = point_start[link : link + 2]
            for j in range(k + 1):
                at = n_of_finger - len(finger.links) + j
                probe_reach[link, :, at] = _reach(hand, finger, j, k, probes[link])
                # A little more than the largest sample: vertices are samples, arcs between are not.
                link_reach[link, at] = 1.02 * _reach(hand, finger, j, k, points[a:b]).max()
    return HandArrays(
        parent=np.asarray(hand.link_parent, dtype=np.int64),
        joint=np.asarray(hand.link_joint, dtype=np.int64),
        R_parent_joint=np.ascontiguousarray(hand.T_parent_joint[:, :3, :3]),
        t_parent_joint=np.ascontiguousarray(hand.T_parent_joint[:, :3, 3]),
        axis=np.ascontiguousarray(axis),
        slides=np.array(
            [joint >= 0 and bool(hand.joint_slides[joint]) for joint in hand.link_joint]
        ),
        piece_link=np.array(piece_link, dtype=np.int64),
        piece_start=np.cumsum([0] + [len(v) for v in vertices]).astype(np.int64),
        piece_vertices=np.concatenate(vertices),
        piece_lower=np.array(lower),
        piece_upper=np.array(upper),
        link_piece_start=link_piece_start,
        point_start=point_start,
        points=points,
        point_normals=np.array(samples.normals_outward),
        probes=probes,
        probe_reach=probe_reach,
        link_middle=link_middle,
        link_radius=from_middle.max(axis=1),
        link_cover=link_cover,
        link_reach=link_reach,
        preshape_joints=np.array(hand.preshape.joints),
        preshape_gain=np.array(hand.preshape.gain),
        first=np.array(hand.first_joint, dtype=np.int64),
        finger_joint=_at_the_end([f.joints for f in hand.fingers], n_of_finger),
        finger_link=_at_the_end([f.links for f in hand.fingers], n_of_finger),
        # The jaws that are brought together share their ways: one may first go that of both.
        finger_upper=hand.of_fingers(hand.joint_upper) * (2.0 if hand.drive.coupled else 1.0),
        finger_unit=np.array(hand.closing_unit),
        closing_ratio=np.array(hand.drive.closing_ratio),
        row_gear=np.array(hand.drive.row_gear),
        row_start=_row_start(hand),
        advances_at_stop=bool(hand.drive.advances_at_stop),
        coupled=bool(hand.drive.coupled),
        open_links=np.flatnonzero(link_finger < 0).astype(np.int64),
        link_is_palm=np.array([group == "palm" for group in hand.link_friction_group]),
        link_is_pad=np.logical_and(link_finger >= 0, hand.contact_patches),
        link_finger=link_finger,
        n_joints=hand.n_joints,
    )


def object_arrays(
    part: Part, friction: Friction, field: DistanceField, tree: TriangleTree
) -> ObjectArrays:
    """Pack an object with the friction of this request."""
    return ObjectArrays(
        field=field.values,
        origin=field.origin,
        spacing=field.spacing,
        triangles=tree.triangles,
        normals=tree.normals_outward,
        lower=tree.lower,
        upper=tree.upper,
        child=tree.child,
        slabs=tree.slabs,
        center_of_mass=np.asarray(part.center_of_mass, dtype=float),
        torque_scale=part.max_radius,
        friction_finger=float(friction.finger),
        friction_palm=float(friction.palm),
    )


def _row_start(hand: HandDescription) -> Array:
    """Where the joints of a finger that touches nothing are when each row begins, (F, D, D)."""
    n = hand.drive.n_links
    start = np.zeros((len(hand.fingers), n, n))
    upper = hand.of_fingers(hand.joint_upper)
    for h in range(n - 1):
        way = upper[:, h] - start[:, h, h]
        start[:, h + 1] = start[:, h] + way[:, None] * hand.drive.closing_ratio[:, h]
    return start


def _at_the_end(rows: Sequence[Sequence[int]], n: int) -> Index:
    """Rows of different lengths as (F, n), each at its end; -1 before."""
    result = np.full((len(rows), n), -1, dtype=np.int64)
    for to, row in zip(result, rows, strict=True):
        to[n - len(row) :] = row
    return result


def _reach(hand: HandDescription, finger: Finger, j: int, k: int, points: Array) -> Array:
    """Speed (n,) of points (n, 3) of a finger's link k per motion of its joint j, at most."""
    link = finger.links[j]
    if hand.joint_slides[finger.joints[j]]:
        return np.ones(len(points))
    if j == k:
        return np.asarray(np.linalg.norm(np.cross(hand.joint_axis[link], points), axis=1))
    offsets = [np.linalg.norm(hand.T_parent_joint[i][:3, 3]) for i in finger.links[j + 1 : k + 1]]
    return np.asarray(sum(offsets) + np.linalg.norm(points, axis=1))


def _probes_of(hand: HandDescription) -> tuple[Array, Array]:
    """Probes (L, K, 3) of the links, and how far a place of the surface is from them at most."""
    known: dict[tuple[int, ...], tuple[Array, float]] = {}
    for pieces in hand.link_collision:
        key = tuple(id(piece) for piece in pieces)
        if key not in known:  # fingers share their meshes
            known[key] = _probes(pieces)
    of_link = [known[tuple(id(piece) for piece in pieces)] for pieces in hand.link_collision]
    return np.array([probes for probes, _ in of_link]), np.array([cover for _, cover in of_link])


def _probes(pieces: tuple[TriangleMesh, ...]) -> tuple[Array, float]:
    """Well-spread points (K, 3) by farthest-point sampling of a link's surface, and their cover."""
    lattice = _lattice(pieces)
    _, one_a_cell = np.unique(np.round(lattice / _PROBE_PITCH), axis=0, return_index=True)
    candidates = lattice[one_a_cell]
    chosen = [int(np.argmax(candidates[:, 0]))]
    distance = np.linalg.norm(candidates - candidates[chosen[0]], axis=1)
    while len(chosen) < _PROBES:
        chosen.append(int(np.argmax(distance)))
        new = np.linalg.norm(candidates - candidates[chosen[-1]], axis=1)
        np.minimum(distance, new, out=distance)
    farthest, _ = cKDTree(candidates[chosen]).query(lattice)
    # The lattice cuts faces into similar triangles with edges of a pitch at most: no place is
    # farther from a corner than the circumradius, or half the longest edge of an obtuse one.
    return candidates[chosen], float(np.max(farthest)) + _PROBE_PITCH / np.sqrt(3.0)


def _lattice(pieces: tuple[TriangleMesh, ...]) -> Array:
    """Points (n, 3) that cover the surface of the pieces' union densely."""
    parts = []
    for index, piece in enumerate(pieces):
        triangles = piece.triangles
        edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)
        pitches = np.ceil(edges.max(axis=1) / _PROBE_PITCH).astype(np.int64)
        for n in np.unique(pitches):
            i, j = np.triu_indices(n + 1)
            weights = np.stack([i, j - i, n - j], axis=1) / n
            points = (weights @ triangles[pitches == n]).reshape(-1, 3)
            for other_index, other in enumerate(pieces):
                if other_index != index:
                    points = points[_height_over(other, points) > -_PROBE_PITCH]
            parts.append(points)
    return np.concatenate(parts)


def _height_over(convex: TriangleMesh, points: Array) -> Array:
    """Largest distance (n,) of points (n, 3) over the planes of a convex mesh's faces."""
    normal = convex.face_normals_outward
    return np.asarray(
        (points @ normal.T - np.einsum("ij,ij->i", normal, convex.triangles[:, 0])).max(axis=1)
    )
