"""Postures for given motor angles, compiled: what ADMM-CP-Opt optimises over.

A hand like the Barrett is under-actuated. For a palm pose, a spread and one angle per finger motor
the inner link goes where its motor takes it, or stops where it touches the object and is freed; the
distal link follows the coupling before that and goes on by itself after it. The distal link alone
is not stopped: whether its contact point lies on, off or in the surface is the constraint that the
optimisation has to satisfy. The one link of a finger without a distal one is an inner link.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.geometry.distance_field import field_value
from gpis_grasp_planner.scene.posture import (
    coarse_step,
    exact_gap,
    overlaps,
    place_hand,
    place_link,
    surely_free,
)

_CLEARANCE = 0.0006
_NEAR = 0.004
_WATCHED_STEP = 0.08  # as in closing
_UNWATCHED = 0.08


@njit
def _close_inner(hand, obj, finger, motor, gap, R, t, work):  # type: ignore[no-untyped-def]
    """Angle at which the inner link stops on its way to `motor`, and whether it touches."""
    link = hand.finger_link[finger, 0]
    unit = hand.finger_unit[finger]
    angle = free = 0.0
    for _ in range(60):
        place_link(hand, link, angle, R, t)
        step, d = coarse_step(hand, obj, finger, 0, R, t, _CLEARANCE, 0)
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
        angle = min(motor, angle + (d - gap) / hand.link_reach[link, 0])
    place_link(hand, link, free, R, t)
    return free, exact_gap(hand, obj, link, R, t, _NEAR, work) < 1e-3


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
def postures_many(hand, obj, T, motors, gap, joints, points, inner_touches):  # type: ignore[no-untyped-def]
    """Postures of motors (B, 1 + F) [spread, fingers] at palm poses T (B, 4, 4).

    Fills joints (B, J), points (B, F, 2, 3), the point of each finger's distal (0) and inner (1)
    link nearest to the object, and inner_touches (B, F).
    """
    n_links = hand.parent.shape[0]
    n_fingers, n_links_each = hand.finger_link.shape
    R = np.empty((n_links, 3, 3))
    t = np.empty((n_links, 3))
    work = np.empty((512, 3))
    for b in range(T.shape[0]):
        q = joints[b]
        q[:] = 0.0
        for k in range(hand.spread_joints.shape[0]):
            q[hand.spread_joints[k]] = motors[b, 0]
        place_hand(hand, q, T[b], R, t)
        for finger in range(n_fingers):
            motor = motors[b, 1 + finger]
            inner, touches = _close_inner(
                hand, obj, finger, min(motor, hand.finger_upper[finger, 0]), gap, R, t, work
            )
            q[hand.finger_joint[finger, 0]] = inner
            place_link(hand, hand.finger_link[finger, 0], inner, R, t)
            last = n_links_each - 1
            if last > 0:
                distal = motor * (1.0 + hand.closing_ratio[0, 1]) - inner
                distal = min(max(distal, 0.0), hand.finger_upper[finger, 1])
                q[hand.finger_joint[finger, 1]] = distal
                place_link(hand, hand.finger_link[finger, 1], distal, R, t)
            inner_touches[b, finger] = touches
            _nearest_point(hand, obj, hand.finger_link[finger, last], R, t, points[b, finger, 0])
            _nearest_point(hand, obj, hand.finger_link[finger, 0], R, t, points[b, finger, 1])
