"""Postures for given motor angles, compiled: what ADMM-CP-Opt optimises over.

A hand like the Barrett is under-actuated. For a palm pose, a pre-shape and one angle per finger
motor an inner link goes where its motor takes it, or stops where it touches the object and is held;
the links outwards of it follow the closing table before that and go on by its next row after it.
The outermost link alone is not stopped: whether its contact point lies on, off or in the surface is
the constraint that the optimisation has to satisfy. The one link of a finger without others is an
inner link.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.geometry.distance_field import field_value
from gpis_grasp_planner.hand.link_mesh import MOST_CORNERS
from gpis_grasp_planner.scene.posture import (
    coarse_step,
    exact_gap,
    overlaps,
    place_hand,
    place_link,
    set_preshape,
    surely_free,
)

_CLEARANCE = 0.0006
_NEAR = 0.004
_WATCHED_STEP = 0.08  # as in closing
_UNWATCHED = 0.08
_BISECTIONS = 14


@njit
def _close_inner(hand, obj, finger, h, start, motor, gap, R, t, work):  # type: ignore[no-untyped-def]
    """Angle at which inner link h stops on its way to `motor`, and whether it touches."""
    link = hand.finger_link[finger, h]
    unit = hand.finger_unit[finger]
    angle = free = start
    for _ in range(60):
        place_link(hand, link, angle, R, t)
        step, d = coarse_step(hand, obj, finger, h, R, t, _CLEARANCE, h)
        if step < 0.002 * unit:
            break
        if surely_free(hand, obj, link, d) <= 0.0:
            if angle - free > _UNWATCHED * unit:
                if overlaps(hand, obj, link, R, t, work):
                    break
                free = angle
            step = min(step, _WATCHED_STEP * unit)
        else:
            free = angle
        if angle >= motor:
            break
        angle = min(angle + step, motor)
    for _ in range(20):
        place_link(hand, link, angle, R, t)
        d = exact_gap(hand, obj, link, R, t, _NEAR, work)
        if d <= 0.0:
            if angle - free < 1e-4 * unit:
                break
            angle = 0.5 * (free + angle)
            continue
        free = angle
        if d < 3.0 * gap:
            return free, True
        if free >= motor:
            return motor, False
        angle = min(motor, angle + (d - gap) / hand.link_reach[link, h])
    place_link(hand, link, free, R, t)
    return free, exact_gap(hand, obj, link, R, t, _NEAR, work) < 1e-3


@njit
def _stop_at(hand, obj, finger, h, k, start, end, of, R, t, work):  # type: ignore[no-untyped-def]
    """Where row h, from `start` to `end`, is stopped by inner link k, and whether it is."""
    free, tried, stopped = start, end, False
    for _ in range(_BISECTIONS):
        for j in range(h, k + 1):
            angle = of[j] + hand.closing_ratio[finger, h, j] * (tried - start)
            place_link(hand, hand.finger_link[finger, j], angle, R, t)
        if overlaps(hand, obj, hand.finger_link[finger, k], R, t, work):
            end, stopped = tried, True
        else:
            free = tried
        if not stopped:
            break
        tried = 0.5 * (free + end)
    return free, stopped


@njit
def _nearest_point(hand, obj, link, R, t, out):  # type: ignore[no-untyped-def]
    """The link's surface point with the smallest field distance, into out; returns that."""
    best = np.inf
    Rl = R[link]
    tl = t[link]
    for n in range(hand.point_start[link], hand.point_start[link + 1]):
        p = hand.points[n]
        x = tl[0] + Rl[0, 0] * p[0] + Rl[0, 1] * p[1] + Rl[0, 2] * p[2]
        y = tl[1] + Rl[1, 0] * p[0] + Rl[1, 1] * p[1] + Rl[1, 2] * p[2]
        z = tl[2] + Rl[2, 0] * p[0] + Rl[2, 1] * p[1] + Rl[2, 2] * p[2]
        d = field_value(obj.field, obj.origin, obj.spacing, x, y, z)
        if d < best:
            best = d
            out[0] = x
            out[1] = y
            out[2] = z
    return best


@njit
def _close_finger(hand, obj, finger, motor, gap, q, R, t, work, of, points, inner_touches):  # type: ignore[no-untyped-def]
    """One finger's joints in q (J,), its points (1 + I, 3) and touches (I,); `of` is work (D,)."""
    n = hand.finger_link.shape[1]
    last = n - 1
    left = motor
    bent = 0.0
    of[:] = 0.0
    h = hand.first[finger]
    while h < max(1, last):
        upper = hand.finger_upper[finger, h]
        start = min(of[h], upper)
        wanted = min(start + left / hand.row_gear[finger, h], upper)
        at, touches = _close_inner(hand, obj, finger, h, start, wanted, gap, R, t, work)
        held = h
        for k in range(h + 1, last):
            at, earlier = _stop_at(hand, obj, finger, h, k, start, at, of, R, t, work)
            if earlier:
                held = k
                touches = True
        way = at - start
        left = max(left - way * hand.row_gear[finger, h], 0.0)
        for k in range(h, n):
            of[k] += hand.closing_ratio[finger, h, k] * way
        if touches:
            inner_touches[held] = True
        elif not (hand.advances_at_stop and at >= upper):
            left = 0.0
        for k in range(h, held + 1):
            link = hand.finger_link[finger, k]
            q[hand.finger_joint[finger, k]] = of[k]
            bent += of[k]
            place_link(hand, link, of[k], R, t)
            _nearest_point(hand, obj, link, R, t, points[1 + k])
        h = held + 1
    if last > 0:
        travel = np.sum(hand.closing_ratio[finger, hand.first[finger]])
        distal = motor * travel - bent
        distal = min(max(distal, 0.0), hand.finger_upper[finger, last])
        q[hand.finger_joint[finger, last]] = distal
        place_link(hand, hand.finger_link[finger, last], distal, R, t)
    _nearest_point(hand, obj, hand.finger_link[finger, last], R, t, points[0])


@njit
def postures_many(hand, obj, T, motors, gap, joints, points, inner_touches):  # type: ignore[no-untyped-def]
    """Postures of motors (B, S + F) [pre-shape, fingers] at palm poses T (B, 4, 4).

    Fills joints (B, J), points (B, F, 1 + I, 3), the point of each finger's outermost (0) and
    inner links nearest to the object, and inner_touches (B, F, I); I is D - 1, or 1 of fingers
    with one link.
    """
    n_links = hand.parent.shape[0]
    n_fingers, n = hand.finger_link.shape
    n_shape = hand.preshape_gain.shape[0]
    R = np.empty((n_links, 3, 3))
    t = np.empty((n_links, 3))
    work = np.empty((MOST_CORNERS, 3))
    of = np.empty(n)
    for b in range(T.shape[0]):
        q = joints[b]
        q[:] = 0.0
        set_preshape(hand, motors[b], q)
        place_hand(hand, q, T[b], R, t)
        for finger in range(n_fingers):
            _close_finger(
                hand, obj, finger, motors[b, n_shape + finger], gap, q, R, t, work, of,
                points[b, finger], inner_touches[b, finger],
            )  # fmt: skip
