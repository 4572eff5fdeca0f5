"""Hand and object as flat arrays, the form in which the compiled loops take them."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.surface_points import surface_points
from gpis_grasp_planner.scene.posture import FEW_POINTS

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class HandArrays(NamedTuple):
    """A hand of L links, P convex pieces, N surface points, F fingers.

    `piece_*` and `point_*` are in the frame of their link. `point_radius` is a point's distance
    from the axis of its own link's joint, `inner_radius` that of a distal link's point from the
    finger's inner axis at most: their speeds per radian of joint motion.
    """

    parent: Index  # (L,)
    joint: Index  # (L,) -1: fixed
    R_parent_joint: Array  # (L, 3, 3)
    t_parent_joint: Array  # (L, 3)
    axis: Array  # (L, 3)
    piece_link: Index  # (P,)
    piece_start: Index  # (P + 1,)
    piece_vertices: Array  # (V, 3)
    piece_lower: Array  # (P, 3)
    piece_upper: Array  # (P, 3)
    link_piece_start: Index  # (L + 1,)
    point_start: Index  # (L + 1,)
    points: Array  # (N, 3)
    point_normals: Array  # (N, 3)
    point_radius: Array  # (N,)
    inner_radius: Array  # (N,)
    link_cover: Array  # (L,) farthest surface point from the link's first FEW_POINTS
    link_radius: Array  # (L,) largest point_radius
    link_inner_radius: Array  # (L,) largest inner_radius
    spread_joints: Index
    inner_joint: Index  # (F,)
    distal_joint: Index  # (F,)
    inner_link: Index  # (F,)
    distal_link: Index  # (F,)
    open_links: Index  # links that the fingers' closing does not move
    link_is_palm: NDArray[np.bool_]  # (L,) friction group
    link_finger: Index  # (L,) finger that moves the link by closing, or -1
    ratio: float  # distal per inner before breakaway
    inner_upper: float
    distal_upper: float
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
    center_of_mass: Array
    torque_scale: float
    friction_finger: float
    friction_palm: float


def hand_arrays(hand: HandDescription) -> HandArrays:
    """Pack a hand. Costs some ms; do it once."""
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
    order, link_cover = _well_spread_first(samples.points, point_start)
    points = np.array(samples.points[order])
    axis = np.asarray(hand.joint_axis, dtype=float)
    point_radius = np.zeros(len(points))
    inner_radius = np.zeros(len(points))
    for link in range(n_links):
        rows = slice(point_start[link], point_start[link + 1])
        point_radius[rows] = np.linalg.norm(np.cross(axis[link], points[rows]), axis=1)
    link_finger = np.full(n_links, -1, dtype=np.int64)
    for index, finger in enumerate(hand.fingers):
        link_finger[finger.inner_link] = index
        link_finger[finger.distal_link] = index
        rows = slice(point_start[finger.distal_link], point_start[finger.distal_link + 1])
        offset = np.linalg.norm(hand.T_parent_joint[finger.distal_link][:3, 3])
        inner_radius[rows] = offset + np.linalg.norm(points[rows], axis=1)
    finger = hand.fingers[0]
    return HandArrays(
        parent=np.asarray(hand.link_parent, dtype=np.int64),
        joint=np.asarray(hand.link_joint, dtype=np.int64),
        R_parent_joint=np.ascontiguousarray(hand.T_parent_joint[:, :3, :3]),
        t_parent_joint=np.ascontiguousarray(hand.T_parent_joint[:, :3, 3]),
        axis=np.ascontiguousarray(axis),
        piece_link=np.array(piece_link, dtype=np.int64),
        piece_start=np.cumsum([0] + [len(v) for v in vertices]).astype(np.int64),
        piece_vertices=np.concatenate(vertices),
        piece_lower=np.array(lower),
        piece_upper=np.array(upper),
        link_piece_start=link_piece_start,
        point_start=point_start,
        points=points,
        point_normals=np.array(samples.normals_outward[order]),
        point_radius=point_radius,
        inner_radius=inner_radius,
        link_cover=link_cover,
        link_radius=_largest_per_link(point_radius, point_start),
        link_inner_radius=_largest_per_link(inner_radius, point_start),
        spread_joints=np.array(
            [f.spread_joint for f in hand.fingers if f.spread_joint >= 0], dtype=np.int64
        ),
        inner_joint=np.array([f.inner_joint for f in hand.fingers], dtype=np.int64),
        distal_joint=np.array([f.distal_joint for f in hand.fingers], dtype=np.int64),
        inner_link=np.array([f.inner_link for f in hand.fingers], dtype=np.int64),
        distal_link=np.array([f.distal_link for f in hand.fingers], dtype=np.int64),
        open_links=np.flatnonzero(link_finger < 0).astype(np.int64),
        link_is_palm=np.array([group == "palm" for group in hand.link_friction_group]),
        link_finger=link_finger,
        ratio=float(hand.drive.distal_per_inner),
        inner_upper=float(hand.joint_upper[finger.inner_joint]),
        distal_upper=float(hand.joint_upper[finger.distal_joint]),
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
        center_of_mass=np.asarray(part.center_of_mass, dtype=float),
        torque_scale=part.max_radius,
        friction_finger=float(friction.finger),
        friction_palm=float(friction.palm),
    )


def _well_spread_first(points: Array, start: Index) -> tuple[Index, Array]:
    """Order of each link's points by farthest-point sampling, and how far the first ones cover."""
    order = np.arange(len(points))
    cover = np.zeros(len(start) - 1)
    for link, (a, b) in enumerate(itertools.pairwise(start)):
        p = points[a:b]
        chosen = [int(np.argmax(p[:, 0]))]
        distance = np.linalg.norm(p - p[chosen[0]], axis=1)
        while len(chosen) < len(p):
            if len(chosen) == FEW_POINTS:
                cover[link] = distance.max()
            chosen.append(int(np.argmax(distance)))
            distance = np.minimum(distance, np.linalg.norm(p - p[chosen[-1]], axis=1))
            distance[chosen] = -1.0
        order[a:b] = a + np.array(chosen)
    return order, cover


def _largest_per_link(values: Array, start: Index) -> Array:
    # A little more than the largest sample: hull vertices are samples, arcs between them are not.
    return np.array(
        [1.02 * values[a:b].max() if b > a else 0.0 for a, b in itertools.pairwise(start)]
    )
