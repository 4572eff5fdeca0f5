"""Compiled forward kinematics and distances of the hand's links from the object and each other."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.geometry.convex_distance import polytope_mesh
from gpis_grasp_planner.geometry.distance_field import field_value
from gpis_grasp_planner.geometry.gjk import polytope_distance
from gpis_grasp_planner.geometry.triangle_tree import nearest_point


@njit(allocates=False)
def place_link(hand, link, angle, R, t):  # type: ignore[no-untyped-def]
    """Pose of one link from its parent's pose, in place in R (L, 3, 3) and t (L, 3).

    `angle` [rad] is a way [m] where the link's joint slides.
    """
    parent = hand.parent[link]
    tx, ty, tz = (
        hand.t_parent_joint[link, 0], hand.t_parent_joint[link, 1], hand.t_parent_joint[link, 2]
    )  # fmt: skip
    for a in range(3):
        t[link, a] = (
            t[parent, a] + R[parent, a, 0] * tx + R[parent, a, 1] * ty + R[parent, a, 2] * tz
        )
    for a in range(3):
        for b in range(3):
            R[link, a, b] = (
                R[parent, a, 0] * hand.R_parent_joint[link, 0, b]
                + R[parent, a, 1] * hand.R_parent_joint[link, 1, b]
                + R[parent, a, 2] * hand.R_parent_joint[link, 2, b]
            )
    x, y, z = hand.axis[link, 0], hand.axis[link, 1], hand.axis[link, 2]
    if hand.slides[link]:
        for a in range(3):
            t[link, a] += angle * R[link, a, 0] * x
            t[link, a] += angle * R[link, a, 1] * y
            t[link, a] += angle * R[link, a, 2] * z
        return
    c = np.cos(angle)
    s = np.sin(angle)
    k = 1.0 - c
    for a in range(3):
        # a row of the joint's frame times Rodrigues' matrix
        u, v, w = R[link, a, 0], R[link, a, 1], R[link, a, 2]
        R[link, a, 0] = u * (c + x * x * k) + v * (y * x * k + z * s) + w * (z * x * k - y * s)
        R[link, a, 1] = u * (x * y * k - z * s) + v * (c + y * y * k) + w * (z * y * k + x * s)
        R[link, a, 2] = u * (x * z * k + y * s) + v * (y * z * k - x * s) + w * (c + z * z * k)


@njit(allocates=False)
def place_hand(hand, joints, T, R, t):  # type: ignore[no-untyped-def]
    """Poses of all links in the object's frame for a palm pose T (4, 4); parents come first."""
    for link in range(hand.parent.shape[0]):
        if hand.parent[link] < 0:
            for a in range(3):
                t[link, a] = T[a, 3]
                for b in range(3):
                    R[link, a, b] = T[a, b]
        else:
            joint = hand.joint[link]
            place_link(hand, link, joints[joint] if joint >= 0 else 0.0, R, t)


@njit(allocates=False)
def coarse_gap(hand, obj, link, R, t):  # type: ignore[no-untyped-def]
    """Smallest field distance of a link's probes [m]; negative inside the object."""
    best = np.inf
    for n in range(hand.probes.shape[1]):
        px, py, pz = hand.probes[link, n, 0], hand.probes[link, n, 1], hand.probes[link, n, 2]
        x = t[link, 0] + R[link, 0, 0] * px + R[link, 0, 1] * py + R[link, 0, 2] * pz
        y = t[link, 1] + R[link, 1, 0] * px + R[link, 1, 1] * py + R[link, 1, 2] * pz
        z = t[link, 2] + R[link, 2, 0] * px + R[link, 2, 1] * py + R[link, 2, 2] * pz
        d = field_value(obj.field, obj.origin, obj.spacing, x, y, z)
        if d < best:
            best = d
    return best


@njit(allocates=False)
def far_from_field(hand, obj, link, R, t):  # type: ignore[no-untyped-def]
    """Whether no probe of a link can have a negative field value: one look in place of all.

    The ball about the link's box holds its probes, and the field is right to two cells at its
    middle and at a probe.
    """
    x, y, z = hand.link_middle[link, 0], hand.link_middle[link, 1], hand.link_middle[link, 2]
    d = field_value(
        obj.field, obj.origin, obj.spacing,
        t[link, 0] + R[link, 0, 0] * x + R[link, 0, 1] * y + R[link, 0, 2] * z,
        t[link, 1] + R[link, 1, 0] * x + R[link, 1, 1] * y + R[link, 1, 2] * z,
        t[link, 2] + R[link, 2, 0] * x + R[link, 2, 1] * y + R[link, 2, 2] * z,
    )  # fmt: skip
    return d > hand.link_radius[link] + 4.0 * obj.spacing


@njit(inline="always")
def surely_free(hand, obj, link, coarse):  # type: ignore[no-untyped-def]
    """How far a link with this `coarse_gap` is from the object at least [m]; may be negative.

    No place of the link is farther than `link_cover` from a probe, and the field is right to
    two cells.
    """
    return coarse - hand.link_cover[link] - 2.0 * obj.spacing


@njit(allocates=False)
def set_preshape(hand, preshape, joints):  # type: ignore[no-untyped-def]
    """Put a pre-shape, the first S of `preshape`, into joints (J,)."""
    for k in range(hand.preshape_joints.shape[0]):
        value = 0.0
        for m in range(hand.preshape_gain.shape[0]):
            value += hand.preshape_gain[m, k] * preshape[m]
        joints[hand.preshape_joints[k]] = value


@njit(allocates=False)
def coarse_step(hand, obj, finger, k, R, t, clearance, held):  # type: ignore[no-untyped-def]
    """Step of the first free joint that should leave `clearance` between link k and the object.

    Looks at the link's probes only: a thin feature of the object can be between them. The finger's
    first `held` joints are at rest.

    Returns
    -------
    (float, float)
        The step, and the probes' smallest distance (`coarse_gap`).
    """
    best = np.inf
    nearest = np.inf
    link = hand.finger_link[finger, k]
    for n in range(hand.probes.shape[1]):
        px, py, pz = hand.probes[link, n, 0], hand.probes[link, n, 1], hand.probes[link, n, 2]
        x = t[link, 0] + R[link, 0, 0] * px + R[link, 0, 1] * py + R[link, 0, 2] * pz
        y = t[link, 1] + R[link, 1, 0] * px + R[link, 1, 1] * py + R[link, 1, 2] * pz
        z = t[link, 2] + R[link, 2, 0] * px + R[link, 2, 1] * py + R[link, 2, 2] * pz
        d = field_value(obj.field, obj.origin, obj.spacing, x, y, z)
        nearest = min(nearest, d)
        d -= clearance
        speed = 0.0
        for j in range(held, k + 1):
            speed += hand.closing_ratio[finger, held, j] * hand.probe_reach[link, n, j]
        speed += 1e-6
        if d < best * speed:
            best = d / speed
    return best, nearest


@njit(allocates=False)
def piece_in_object_frame(hand, piece, R, t, out):  # type: ignore[no-untyped-def]
    """Vertices of a convex piece in the object's frame, into out; returns how many."""
    link = hand.piece_link[piece]
    first = hand.piece_start[piece]
    n = hand.piece_start[piece + 1] - first
    for i in range(n):
        x = hand.piece_vertices[first + i, 0]
        y = hand.piece_vertices[first + i, 1]
        z = hand.piece_vertices[first + i, 2]
        for a in range(3):
            out[i, a] = t[link, a] + R[link, a, 0] * x + R[link, a, 1] * y + R[link, a, 2] * z
    return n


@njit
def _seed_triangle(hand, obj, link, R, t, limit):  # type: ignore[no-untyped-def]
    """The mesh's triangle nearest to the link's deepest probe; -1 none, -2 link is far."""
    best = np.inf
    bx = by = bz = 0.0
    for n in range(hand.probes.shape[1]):
        px, py, pz = hand.probes[link, n, 0], hand.probes[link, n, 1], hand.probes[link, n, 2]
        x = t[link, 0] + R[link, 0, 0] * px + R[link, 0, 1] * py + R[link, 0, 2] * pz
        y = t[link, 1] + R[link, 1, 0] * px + R[link, 1, 1] * py + R[link, 1, 2] * pz
        z = t[link, 2] + R[link, 2, 0] * px + R[link, 2, 1] * py + R[link, 2, 2] * pz
        d = field_value(obj.field, obj.origin, obj.spacing, x, y, z)
        if d < best:
            best = d
            bx, by, bz = x, y, z
    if surely_free(hand, obj, link, best) > limit:
        return -2
    q = np.empty(3)
    _, face, _ = nearest_point(
        bx, by, bz, abs(best) + 3.0 * obj.spacing, obj.triangles, obj.lower, obj.upper, obj.child, q
    )
    return face


@njit(allocates=False)
def exact_gap(hand, obj, link, R, t, limit, work):  # type: ignore[no-untyped-def]
    """Distance of a link from the object's mesh [m], at most `limit`; 0 where they overlap."""
    seed = _seed_triangle(hand, obj, link, R, t, limit)
    if seed == -2:
        return limit
    best = limit
    for piece in range(hand.link_piece_start[link], hand.link_piece_start[link + 1]):
        n = piece_in_object_frame(hand, piece, R, t, work)
        d = polytope_mesh(
            work[:n], R[link], t[link], hand.piece_lower[piece], hand.piece_upper[piece], best,
            seed, obj.triangles, obj.lower, obj.upper, obj.child, obj.slabs,
        )  # fmt: skip
        if d <= 0.0:
            return 0.0
        best = min(best, d)
    return best


@njit(allocates=False)
def overlaps(hand, obj, link, R, t, work):  # type: ignore[no-untyped-def]
    """Whether a link and the object's mesh overlap."""
    return exact_gap(hand, obj, link, R, t, 1e-4, work) <= 0.0


@njit(allocates=False)
def _apart_along_own_axes(hand, piece, other, R, t, limit):  # type: ignore[no-untyped-def]
    """Whether a plane across an axis of a piece's link keeps both boxes farther apart than `limit`.

    A little more than `limit`, for the rounding.
    """
    a, b = hand.piece_link[piece], hand.piece_link[other]
    for i in range(3):
        middle = 0.0
        for c in range(3):
            middle += R[a, c, i] * (t[b, c] - t[a, c])
        reach = 0.0
        for j in range(3):
            along = R[a, 0, i] * R[b, 0, j] + R[a, 1, i] * R[b, 1, j] + R[a, 2, i] * R[b, 2, j]
            low, high = hand.piece_lower[other, j], hand.piece_upper[other, j]
            middle += along * 0.5 * (low + high)
            reach += abs(along) * 0.5 * (high - low)
        margin = limit + 1e-9
        if middle - reach > hand.piece_upper[piece, i] + margin:
            return True
        if middle + reach < hand.piece_lower[piece, i] - margin:
            return True
    return False


@njit(allocates=False)
def boxes_apart(hand, piece, other, R, t, limit):  # type: ignore[no-untyped-def]
    """Whether two pieces are farther apart than `limit`, as far as their boxes tell."""
    return _apart_along_own_axes(hand, piece, other, R, t, limit) or _apart_along_own_axes(
        hand, other, piece, R, t, limit
    )


@njit
def finger_meets_hand(hand, finger, R, t, limit, work, other):  # type: ignore[no-untyped-def]
    """Whether a finger's moving links are nearer than `limit` to a link of another finger.

    Links of the palm group and knuckles do not count for the inner link, that turns in its own
    knuckle or slides on the palm.
    """
    direction = np.empty(3)
    p = np.empty(3)
    q = np.empty(3)
    first = hand.first[finger]
    for k in range(hand.finger_link.shape[1] - 1, first - 1, -1):
        link = hand.finger_link[finger, k]
        for piece in range(hand.link_piece_start[link], hand.link_piece_start[link + 1]):
            n = 0
            for target in range(hand.parent.shape[0]):
                own = hand.link_finger[target] == finger
                fixed = hand.link_finger[target] < 0
                if own or (fixed and k == first):
                    continue
                if fixed and hand.parent[hand.finger_link[finger, first]] == target:
                    continue
                for o in range(hand.link_piece_start[target], hand.link_piece_start[target + 1]):
                    if boxes_apart(hand, piece, o, R, t, limit):
                        continue
                    if n == 0:
                        n = piece_in_object_frame(hand, piece, R, t, work)
                    m = piece_in_object_frame(hand, o, R, t, other)
                    for a in range(3):
                        direction[a] = t[link, a] - t[target, a]
                    d = polytope_distance(work[:n], other[:m], limit, direction, p, q)
                    if d < limit:
                        return True
    return False
