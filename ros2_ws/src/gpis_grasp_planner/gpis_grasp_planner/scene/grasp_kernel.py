"""One grasp attempt from palm pose to quality, compiled, and loops over many of them."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.hand.link_mesh import MOST_CORNERS
from gpis_grasp_planner.quality.fast_epsilon import fast_epsilon
from gpis_grasp_planner.quality.volume_estimate import volume_estimate
from gpis_grasp_planner.scene.centring import centre_hand
from gpis_grasp_planner.scene.closing import close_hand
from gpis_grasp_planner.scene.free_hand import hand_meets_itself
from gpis_grasp_planner.scene.palm import clear_palm, hand_gap, retreat_is_free
from gpis_grasp_planner.scene.posture import place_hand, set_preshape
from gpis_grasp_planner.scene.touch import collect_contacts

MAX_CONTACTS = 24
_GOOD = 0.01

GRASPED = 0
PALM_COLLISION = 1
SELF_COLLISION = 2
TOO_FEW_CONTACTS = 3
NO_WAY_BACK = 4


@njit(allocates=False)
def pyramid_wrenches(obj, positions, normals, friction, k, edges, out):  # type: ignore[no-untyped-def]
    """As `quality.wrench_space.contact_wrenches`, into out (k * edges, 6)."""
    for i in range(k):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        if abs(nx) > 1.0 - 1e-7:
            tx, ty, tz = ny, -nx, 0.0
        else:
            tx, ty, tz = 0.0, nz, -ny
        length = np.sqrt(tx * tx + ty * ty + tz * tz)
        bx, by, bz = tx / length, ty / length, tz / length
        ax = by * nz - bz * ny
        ay = bz * nx - bx * nz
        az = bx * ny - by * nx
        px = positions[i, 0] - obj.center_of_mass[0]
        py = positions[i, 1] - obj.center_of_mass[1]
        pz = positions[i, 2] - obj.center_of_mass[2]
        for e in range(edges):
            angle = 2.0 * np.pi * e / edges
            c = friction[i] * np.cos(angle)
            s = friction[i] * np.sin(angle)
            fx = nx + c * ax + s * bx
            fy = ny + c * ay + s * by
            fz = nz + c * az + s * bz
            row = out[i * edges + e]
            row[0] = fx
            row[1] = fy
            row[2] = fz
            row[3] = (py * fz - pz * fy) / obj.torque_scale
            row[4] = (pz * fx - px * fz) / obj.torque_scale
            row[5] = (px * fy - py * fx) / obj.torque_scale


@njit(allocates=False)
def attempt_from(
    hand, obj, T, start, check_start, gap, threshold, edges, retreat, directions, n_starts,
    n_starts_good, joints, positions, normals, friction, links, R, t, work, other, wrenches,
):  # type: ignore[no-untyped-def]  # fmt: skip
    """Close the hand from posture `start` at palm pose T and measure.

    With `check_start` the fingers must not meet each other in it, either. The palm of a coupled
    hand is moved in T (`scene.centring`). Returns (status, contacts, epsilon, volume).
    """
    for j in range(start.shape[0]):
        joints[j] = start[j]
    place_hand(hand, joints, T, R, t)
    if hand_gap(hand, obj, R, t, threshold, work) <= 0.0:
        return PALM_COLLISION, 0, -1.0, 0.0
    if check_start and hand_meets_itself(hand, R, t, work, other):
        return SELF_COLLISION, 0, -1.0, 0.0
    touching = close_hand(hand, obj, joints, gap, R, t, work, other)
    if touching < 0:
        return SELF_COLLISION, 0, -1.0, 0.0
    if touching == 0:
        return TOO_FEW_CONTACTS, 0, -1.0, 0.0
    if hand.coupled:
        if touching < hand.finger_link.shape[0]:
            return TOO_FEW_CONTACTS, 0, -1.0, 0.0
        if not centre_hand(hand, obj, T, start, joints, threshold, R, t, work):
            return PALM_COLLISION, 0, -1.0, 0.0
    k = collect_contacts(hand, obj, R, t, threshold, work, positions, normals, links)
    if k < 2:
        return TOO_FEW_CONTACTS, k, -1.0, 0.0
    for i in range(k):
        friction[i] = obj.friction_palm if hand.link_is_palm[links[i]] else obj.friction_finger
    pyramid_wrenches(obj, positions, normals, friction, k, edges, wrenches)
    W = wrenches[: k * edges]
    # The upper bound is what ranks, so that the overestimated would collect at the top: more
    # starts for the good.
    epsilon = fast_epsilon(W, directions, n_starts, n_starts_good - n_starts, _GOOD)
    goes_back = epsilon > 0.0 and retreat > 0.0
    if goes_back and not retreat_is_free(hand, obj, T, start, retreat, 6, R, t):
        return NO_WAY_BACK, k, -1.0, 0.0
    return GRASPED, k, epsilon, volume_estimate(W, k)


@njit
def attempt_many(
    hand, obj, T, preshape, gap, threshold, edges, retreat, directions, n_starts, n_starts_good,
    status, count, epsilon, volume, joints, positions, normals, friction, links,
):  # type: ignore[no-untyped-def]  # fmt: skip
    """`attempt_from` for every row, with open fingers; the arrays are filled."""
    start = np.zeros((T.shape[0], hand.n_joints))
    for b in range(T.shape[0]):
        set_preshape(hand, preshape[b], start[b])
    # Of NumPy's type: a literal False would be a type of its own, and all compiled for it again.
    check_start = np.bool_(False)
    attempt_many_from(
        hand, obj, T, start, check_start, gap, threshold, edges, retreat, directions, n_starts,
        n_starts_good, status, count, epsilon, volume, joints, positions, normals, friction, links,
    )  # fmt: skip


@njit
def attempt_many_from(
    hand, obj, T, start, check_start, gap, threshold, edges, retreat, directions, n_starts,
    n_starts_good, status, count, epsilon, volume, joints, positions, normals, friction, links,
):  # type: ignore[no-untyped-def]  # fmt: skip
    """`attempt_from` for every row; the arrays are filled."""
    n_links = hand.parent.shape[0]
    R = np.empty((n_links, 3, 3))
    t = np.empty((n_links, 3))
    work = np.empty((MOST_CORNERS, 3))
    other = np.empty((MOST_CORNERS, 3))
    wrenches = np.empty((MAX_CONTACTS * edges, 6))
    for b in range(T.shape[0]):
        status[b], count[b], epsilon[b], volume[b] = attempt_from(
            hand, obj, T[b], start[b], check_start, gap, threshold, edges, retreat, directions,
            n_starts, n_starts_good, joints[b], positions[b], normals[b], friction[b], links[b],
            R, t, work, other, wrenches,
        )  # fmt: skip


@njit
def clear_many(hand, obj, T, normal, preshape, step, reach, turn, gap, standoff, free):  # type: ignore[no-untyped-def]
    """`clear_palm` for every row, in place in T; `free` tells which ended without collision."""
    n_links = hand.parent.shape[0]
    R = np.empty((n_links, 3, 3))
    t = np.empty((n_links, 3))
    work = np.empty((MOST_CORNERS, 3))
    joints = np.zeros(hand.n_joints)
    for b in range(T.shape[0]):
        set_preshape(hand, preshape[b], joints)
        free[b] = clear_palm(
            hand, obj, T[b], normal[b], joints, step, reach, turn, gap, standoff[b], R, t, work
        )
