"""Contacts of a closed hand, compiled: where links are within the contact threshold.

A link that touches has a patch of contact, and the wrench space is the hull of its points, so the
patch's extreme points count. Candidates are the nearest points of the link and each near triangle
(exact), and the link's surface samples within the threshold of the mesh (exact distances too).
A pair counts only if it is a contact of the bodies, not of features on their own: the hand's point
must have no nearer point of the mesh, and where the mesh's nearest feature is an edge the
direction must agree with the hand's normal. From each link the farthest-apart few are kept; of a
link with flat pads (`HandDescription.contact_patches`) the corners of the patch, the farthest
points in eight directions in its plane. What presses with a pressure spread over a patch can exert
any mean of forces in the cones at these corners, so that their hull is what the pad can do; a
patch whose corners lie between samples is taken as that much smaller.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.geometry.convex_distance import near_pairs
from gpis_grasp_planner.geometry.distance_field import field_value
from gpis_grasp_planner.geometry.triangle_tree import nearest_point
from gpis_grasp_planner.scene.posture import exact_gap, piece_in_object_frame

MAX_PER_LINK = 5
MAX_PER_PATCH = 8
_CANDIDATES = 256
_APART = 0.0015
_SAME_NORMAL = 0.94


@njit
def _pair_candidates(hand, obj, link, R, t, threshold, work, points, normals, gaps):  # type: ignore[no-untyped-def]
    count = 0
    p_self = np.empty((64, 3))
    p_other = np.empty((64, 3))
    for piece in range(hand.link_piece_start[link], hand.link_piece_start[link + 1]):
        n = piece_in_object_frame(hand, piece, R, t, work)
        k = near_pairs(
            work[:n], R[link], t[link], hand.piece_lower[piece], hand.piece_upper[piece],
            threshold, obj.triangles, obj.lower, obj.upper, obj.child, obj.slabs, p_self, p_other,
        )  # fmt: skip
        for i in range(k):
            dx = p_other[i, 0] - p_self[i, 0]
            dy = p_other[i, 1] - p_self[i, 1]
            dz = p_other[i, 2] - p_self[i, 2]
            d = np.sqrt(dx * dx + dy * dy + dz * dz)
            if d < 1e-9 or count >= points.shape[0]:
                continue
            for c in range(3):
                points[count, c] = p_other[i, c]
            normals[count, 0] = dx / d
            normals[count, 1] = dy / d
            normals[count, 2] = dz / d
            gaps[count] = d
            count += 1
    return count


@njit
def _sample_candidates(hand, obj, link, R, t, threshold, points, normals, gaps, count):  # type: ignore[no-untyped-def]
    q = np.empty(3)
    for n in range(hand.point_start[link], hand.point_start[link + 1]):
        if count >= points.shape[0]:
            break
        px, py, pz = hand.points[n, 0], hand.points[n, 1], hand.points[n, 2]
        x = t[link, 0] + R[link, 0, 0] * px + R[link, 0, 1] * py + R[link, 0, 2] * pz
        y = t[link, 1] + R[link, 1, 0] * px + R[link, 1, 1] * py + R[link, 1, 2] * pz
        z = t[link, 2] + R[link, 2, 0] * px + R[link, 2, 1] * py + R[link, 2, 2] * pz
        d = field_value(obj.field, obj.origin, obj.spacing, x, y, z)
        if d > threshold + 0.5 * obj.spacing or d < -obj.spacing:
            continue
        d, face, in_face = nearest_point(
            x, y, z, threshold, obj.triangles, obj.lower, obj.upper, obj.child, q
        )
        if face < 0 or d < 1e-9:
            continue
        mx = hand.point_normals[n, 0]
        my = hand.point_normals[n, 1]
        mz = hand.point_normals[n, 2]
        hx = R[link, 0, 0] * mx + R[link, 0, 1] * my + R[link, 0, 2] * mz
        hy = R[link, 1, 0] * mx + R[link, 1, 1] * my + R[link, 1, 2] * mz
        hz = R[link, 2, 0] * mx + R[link, 2, 1] * my + R[link, 2, 2] * mz
        ix = (q[0] - x) / d
        iy = (q[1] - y) / d
        iz = (q[2] - z) / d
        agree = hx * ix + hy * iy + hz * iz
        if agree < (0.5 if in_face else 0.99):
            continue
        for c in range(3):
            points[count, c] = q[c]
        normals[count, 0] = ix
        normals[count, 1] = iy
        normals[count, 2] = iz
        gaps[count] = d
        count += 1
    return count


@njit
def _spread_out(points, normals, gaps, count, chosen):  # type: ignore[no-untyped-def]
    """Indices of up to MAX_PER_LINK candidates: the nearest, then always the farthest apart."""
    first = 0
    for i in range(count):
        if gaps[i] < gaps[first]:
            first = i
    chosen[0] = first
    k = 1
    apart = np.full(count, np.inf)
    while k < chosen.shape[0]:
        last = chosen[k - 1]
        best = -1.0
        index = -1
        for i in range(count):
            d = 0.0
            agree = 0.0
            for c in range(3):
                d += (points[i, c] - points[last, c]) ** 2
                agree += normals[i, c] * normals[last, c]
            d = np.sqrt(d)
            if agree < _SAME_NORMAL:
                d = max(d, 2.0 * _APART)
            apart[i] = min(apart[i], d)
            if apart[i] > best:
                best = apart[i]
                index = i
        if best < _APART:
            break
        chosen[k] = index
        k += 1
    return k


@njit
def _patch_corners(points, normals, gaps, count, Rl, chosen):  # type: ignore[no-untyped-def]
    """Indices of the corners of a flat patch about the nearest candidate, at most MAX_PER_PATCH.

    The directions lie evenly about the link's axes in the patch's plane: of a rectangle along them
    the four corners are found.
    """
    first = 0
    for i in range(count):
        if gaps[i] < gaps[first]:
            first = i
    n = normals[first]
    most = 0  # the link's axis nearest to the normal
    for a in range(1, 3):
        here = abs(Rl[0, a] * n[0] + Rl[1, a] * n[1] + Rl[2, a] * n[2])
        if here > abs(Rl[0, most] * n[0] + Rl[1, most] * n[1] + Rl[2, most] * n[2]):
            most = a
    u = Rl[:, (most + 1) % 3]
    v = Rl[:, (most + 2) % 3]
    k = 0
    for e in range(MAX_PER_PATCH):
        angle = 2.0 * np.pi * (e + 0.5) / MAX_PER_PATCH
        c = np.cos(angle)
        s = np.sin(angle)
        best = -np.inf
        index = first
        for i in range(count):
            agree = normals[i, 0] * n[0] + normals[i, 1] * n[1] + normals[i, 2] * n[2]
            if agree < _SAME_NORMAL:
                continue
            reach = 0.0
            for a in range(3):
                reach += (points[i, a] - points[first, a]) * (c * u[a] + s * v[a])
            if reach > best:
                best = reach
                index = i
        apart = True
        for j in range(k):
            d = 0.0
            for a in range(3):
                d += (points[index, a] - points[chosen[j], a]) ** 2
            apart = apart and np.sqrt(d) >= _APART
        if apart:
            chosen[k] = index
            k += 1
    return k


@njit
def collect_contacts(hand, obj, R, t, threshold, work, positions, normals, links):  # type: ignore[no-untyped-def]
    """Contacts of all links into positions, normals (inward) and links; returns how many."""
    found = 0
    points = np.empty((_CANDIDATES, 3))
    inward = np.empty((_CANDIDATES, 3))
    gaps = np.empty(_CANDIDATES)
    chosen = np.empty(MAX_PER_LINK, dtype=np.int64)
    corners = np.empty(MAX_PER_PATCH, dtype=np.int64)
    for link in range(hand.parent.shape[0]):
        if exact_gap(hand, obj, link, R, t, threshold, work) >= threshold:
            continue
        count = _pair_candidates(hand, obj, link, R, t, threshold, work, points, inward, gaps)
        count = _sample_candidates(hand, obj, link, R, t, threshold, points, inward, gaps, count)
        if count == 0:
            continue
        if hand.link_is_pad[link]:
            k = _patch_corners(points, inward, gaps, count, R[link], corners)
        else:
            k = _spread_out(points, inward, gaps, count, chosen)
        for i in range(k):
            if found >= positions.shape[0]:
                break
            which = corners[i] if hand.link_is_pad[link] else chosen[i]
            for c in range(3):
                positions[found, c] = points[which, c]
                normals[found, c] = inward[which, c]
            links[found] = link
            found += 1
    return found
