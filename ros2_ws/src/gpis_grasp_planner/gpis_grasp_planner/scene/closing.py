"""AutoGrasp, compiled: the fingers close until contact, with coupling and breakaway.

Every finger closes at its own until a link touches. An inner link that touches is freed and
holds (the TorqueSwitch breakaway) while the distal link goes on at 4/3 of the inner link's rate;
a distal link that touches stops its finger. Far away the distance field at some probes on
the links says how far they may go, and where a thin feature of the object could be between the
probes an exact test follows every step; near contact steps come from the exact distance and the
largest speed of the link's points. The closing ends with a gap of some hundredths of a millimetre
at most, never in penetration: an overlap that a step runs into is taken back.

The simulator that the paper used closes in steps of 0.01 rad instead; the result is the same
contact, nearer to its threshold.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.scene.posture import (
    coarse_step,
    exact_gap,
    finger_meets_hand,
    overlaps,
    place_link,
    surely_free,
)

_COARSE_STEPS = 60
_EXACT_STEPS = 40
_COARSE_CLEARANCE = 0.0006
_NEAR = 0.004
# Where a thin feature may be between the probes: largest step, and how far a finger goes before
# the next exact test [rad]. Together they move a fingertip by no more than about its thickness.
_WATCHED_STEP = 0.08
_UNWATCHED = 0.08


@njit
def _place_finger(hand, finger, inner, distal, R, t):  # type: ignore[no-untyped-def]
    place_link(hand, hand.inner_link[finger], inner, R, t)
    place_link(hand, hand.distal_link[finger], distal, R, t)


@njit
def _step(d, before, moved, gap, speed):  # type: ignore[no-untyped-def]
    """Next motor step [rad] towards a gap: surely safe, or by the slope of the last two gaps.

    The touching point is often much slower than the link's fastest one; the slope knows. A step
    that overshoots is seen by the next exact distance and taken back.
    """
    step = (d - gap) / speed
    if before < _NEAR and d < before and moved > 0.0:
        step = max(step, 0.95 * (d - gap) * moved / (before - d))
    return min(step, 0.05)


@njit
def _back(free, angle):  # type: ignore[no-untyped-def]
    """Where to try after an overlap: halfway to the last free angle, 0.03 rad at most."""
    return max(0.5 * (free + angle), angle - 0.03)


@njit
def _advance_both(hand, obj, finger, start, gap, R, t, work):  # type: ignore[no-untyped-def]
    """Close with the coupling from `start` until a link touches.

    Returns (inner angle, 1 inner link touched | 2 distal link touched | 0 end of the motor).
    """
    inner_link = hand.inner_link[finger]
    distal_link = hand.distal_link[finger]
    ratio = hand.ratio
    angle = free = start
    for _ in range(_COARSE_STEPS):
        _place_finger(hand, finger, angle, min(ratio * angle, hand.distal_upper), R, t)
        step_inner, d_inner = coarse_step(hand, obj, inner_link, R, t, _COARSE_CLEARANCE, 0.0, 1.0)
        step_distal, d_distal = coarse_step(
            hand, obj, distal_link, R, t, _COARSE_CLEARANCE, 1.0, ratio
        )
        step = min(step_inner, step_distal)
        if step < 0.002:
            break
        watch_inner = surely_free(hand, obj, inner_link, d_inner) <= 0.0
        watch_distal = surely_free(hand, obj, distal_link, d_distal) <= 0.0
        at_end = angle >= hand.inner_upper
        if watch_inner or watch_distal:
            if at_end or angle - free > _UNWATCHED:
                if watch_inner and overlaps(hand, obj, inner_link, R, t, work):
                    break
                if watch_distal and overlaps(hand, obj, distal_link, R, t, work):
                    break
                free = angle
            step = min(step, _WATCHED_STEP)
        else:
            free = angle
        if at_end:
            return hand.inner_upper, 0
        angle = min(angle + step, hand.inner_upper)
    speed_inner = hand.link_radius[inner_link]
    speed_distal = hand.link_inner_radius[distal_link] + ratio * hand.link_radius[distal_link]
    before_inner = before_distal = _NEAR
    for _ in range(_EXACT_STEPS):
        _place_finger(hand, finger, angle, min(ratio * angle, hand.distal_upper), R, t)
        d_inner = exact_gap(hand, obj, inner_link, R, t, _NEAR, work)
        d_distal = exact_gap(hand, obj, distal_link, R, t, _NEAR, work)
        if d_inner <= 0.0 or d_distal <= 0.0:
            # the field missed a feature between the samples: go back and come again
            overlap = 1 if d_inner <= 0.0 else 2
            angle = _back(free, angle)
            if angle - free < 1e-5:
                _place_finger(hand, finger, free, min(ratio * free, hand.distal_upper), R, t)
                return free, overlap
            before_inner = before_distal = _NEAR
            continue
        if d_inner < 2.0 * gap:
            return angle, 1
        if d_distal < 2.0 * gap:
            return angle, 2
        if angle >= hand.inner_upper:
            return hand.inner_upper, 0
        step = min(
            _step(d_inner, before_inner, angle - free, gap, speed_inner),
            _step(d_distal, before_distal, angle - free, gap, speed_distal),
        )
        free = angle
        before_inner = d_inner
        before_distal = d_distal
        angle = min(angle + step, hand.inner_upper)
    _place_finger(hand, finger, free, min(ratio * free, hand.distal_upper), R, t)
    return free, (1 if d_inner < d_distal else 2)


@njit
def _advance_distal(hand, obj, finger, start, gap, R, t, work):  # type: ignore[no-untyped-def]
    """Close the distal link alone; returns (distal angle, whether it touched)."""
    link = hand.distal_link[finger]
    angle = free = start
    for _ in range(_COARSE_STEPS):
        place_link(hand, link, angle, R, t)
        step, d = coarse_step(hand, obj, link, R, t, _COARSE_CLEARANCE, 0.0, 1.0)
        if step < 0.002:
            break
        at_end = angle >= hand.distal_upper
        if surely_free(hand, obj, link, d) <= 0.0:
            if at_end or angle - free > _UNWATCHED:
                if overlaps(hand, obj, link, R, t, work):
                    break
                free = angle
            step = min(step, _WATCHED_STEP)
        else:
            free = angle
        if at_end:
            return hand.distal_upper, False
        angle = min(angle + step, hand.distal_upper)
    speed = hand.link_radius[link]
    before = _NEAR
    for _ in range(_EXACT_STEPS):
        place_link(hand, link, angle, R, t)
        d = exact_gap(hand, obj, link, R, t, _NEAR, work)
        if d <= 0.0:
            angle = _back(free, angle)
            if angle - free < 1e-5:
                break
            before = _NEAR
            continue
        if d < 2.0 * gap:
            return angle, True
        if angle >= hand.distal_upper:
            return hand.distal_upper, False
        step = _step(d, before, angle - free, gap, speed)
        free = angle
        before = d
        angle = min(angle + step, hand.distal_upper)
    place_link(hand, link, free, R, t)
    return free, exact_gap(hand, obj, link, R, t, _NEAR, work) < 4.0 * gap


@njit
def close_hand(hand, obj, joints, gap, R, t, work, other):  # type: ignore[no-untyped-def]
    """Close all fingers from `joints` (spread set, fingers open); `joints`, R and t follow.

    Returns the number of fingers that touch the object, or -1 where a finger that touches it
    runs into another one. A finger that finds nothing closes to its end, but not into the hand.
    """
    n_fingers = hand.inner_joint.shape[0]
    touching = 0
    touched = np.zeros(n_fingers, dtype=np.bool_)
    for finger in range(n_fingers):
        start = joints[hand.inner_joint[finger]]
        inner, what = _advance_both(hand, obj, finger, start, gap, R, t, work)
        distal = min(hand.ratio * inner, hand.distal_upper)
        if what == 1:
            distal, _ = _advance_distal(hand, obj, finger, distal, gap, R, t, work)
        touched[finger] = what > 0
        touching += what > 0
        joints[hand.inner_joint[finger]] = inner
        joints[hand.distal_joint[finger]] = distal
        _place_finger(hand, finger, inner, distal, R, t)
    for finger in range(n_fingers):
        if touched[finger]:
            continue
        while finger_meets_hand(hand, finger, R, t, 1e-4, work, other):
            inner = max(joints[hand.inner_joint[finger]] - 0.05, 0.0)
            joints[hand.inner_joint[finger]] = inner
            joints[hand.distal_joint[finger]] = min(hand.ratio * inner, hand.distal_upper)
            _place_finger(hand, finger, inner, joints[hand.distal_joint[finger]], R, t)
            if inner <= 0.0:
                break
    for finger in range(n_fingers):
        if touched[finger] and finger_meets_hand(hand, finger, R, t, 1e-5, work, other):
            return -1
    return touching
