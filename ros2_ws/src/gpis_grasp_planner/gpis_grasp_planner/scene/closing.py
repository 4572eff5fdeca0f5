"""AutoGrasp, compiled: the fingers close until contact, each by its closing table.

Every finger closes at its own until a link touches. By its table (`HandArrays.closing_ratio`) the
links from there inwards are held while those outwards of it go on; its outermost link that touches
stops the finger. For the Barrett that is the TorqueSwitch breakaway: an inner link that touches is
freed and holds while the distal link goes on. Of a hand that advances at stops a joint at its
stop is held as well, and the next row goes on. A finger that slides has one link, and its way in
metres counts by `HandArrays.finger_unit`. The fingers of a coupled hand are brought to one position
afterwards (`scene.centring`).

Far away the distance field at some probes on the links says how far they may go, and where a thin
feature of the object could be between the probes an exact test follows every step; near contact
steps come from the exact distance and the largest speed of the link's points. The closing ends with
a gap of some hundredths of a millimetre at most, never in penetration: an overlap that a step runs
into is taken back.

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


@njit(allocates=False)
def _move_finger(hand, finger, held, s, base, q, R, t):  # type: ignore[no-untyped-def]
    """Put the finger's free joints where they are with the first of them at `s`, into q (D,)."""
    for k in range(held, hand.finger_link.shape[1]):
        moved = base[k] + hand.closing_ratio[finger, held, k] * s
        q[k] = min(moved, hand.finger_upper[finger, k])
        place_link(hand, hand.finger_link[finger, k], q[k], R, t)


@njit
def _step(d, before, moved, gap, speed, unit):  # type: ignore[no-untyped-def]
    """Next step towards a gap: surely safe, or by the slope of the last two gaps.

    The touching point is often much slower than the link's fastest one; the slope knows. A step
    that overshoots is seen by the next exact distance and taken back.
    """
    step = (d - gap) / speed
    if before < _NEAR and d < before and moved > 0.0:
        step = max(step, 0.95 * (d - gap) * moved / (before - d))
    return min(step, 0.05 * unit)


@njit
def _back(free, angle, unit):  # type: ignore[no-untyped-def]
    """Where to try after an overlap: halfway to the last free angle, 0.03 rad at most."""
    return max(0.5 * (free + angle), angle - 0.03 * unit)


@njit
def _advance(hand, obj, finger, held, start, base, q, gap, R, t, work):  # type: ignore[no-untyped-def]
    """Move the finger's joints after the first `held` from `start` until a link touches.

    Returns (position of the first free joint, index of the touching link or -1 at its end).
    """
    n = hand.finger_link.shape[1]
    unit = hand.finger_unit[finger]
    end = hand.finger_upper[finger, held]
    d = np.empty(n)
    before = np.empty(n)
    angle = free = start
    for _ in range(_COARSE_STEPS):
        _move_finger(hand, finger, held, angle, base, q, R, t)
        step = np.inf
        watched = False
        for k in range(held, n):
            way, d[k] = coarse_step(hand, obj, finger, k, R, t, _COARSE_CLEARANCE, held)
            step = min(step, way)
        if step < 0.002 * unit:
            break
        for k in range(held, n):
            if surely_free(hand, obj, hand.finger_link[finger, k], d[k]) <= 0.0:
                watched = True
        at_end = angle >= end
        if watched:
            if at_end or angle - free > _UNWATCHED * unit:
                overlap = False
                for k in range(held, n):
                    link = hand.finger_link[finger, k]
                    if surely_free(hand, obj, link, d[k]) <= 0.0:
                        overlap = overlap or overlaps(hand, obj, link, R, t, work)
                if overlap:
                    break
                free = angle
            step = min(step, _WATCHED_STEP * unit)
        else:
            free = angle
        if at_end:
            return end, -1
        angle = min(angle + step, end)
    before[:] = _NEAR
    for _ in range(_EXACT_STEPS):
        _move_finger(hand, finger, held, angle, base, q, R, t)
        for k in range(held, n):
            d[k] = exact_gap(hand, obj, hand.finger_link[finger, k], R, t, _NEAR, work)
        touching = -1
        for k in range(n - 1, held - 1, -1):
            if d[k] <= 0.0:
                touching = k
        if touching >= 0:
            # the field missed a feature between the samples: go back and come again
            angle = _back(free, angle, unit)
            if angle - free < 1e-5 * unit:
                _move_finger(hand, finger, held, free, base, q, R, t)
                return free, touching
            before[:] = _NEAR
            continue
        for k in range(held, n):
            if d[k] < 2.0 * gap:
                return angle, k
        if angle >= end:
            return end, -1
        step = np.inf
        for k in range(held, n):
            speed = 0.0
            for j in range(held, k + 1):
                reach = hand.link_reach[hand.finger_link[finger, k], j]
                speed += hand.closing_ratio[finger, held, j] * reach
            step = min(step, _step(d[k], before[k], angle - free, gap, speed, unit))
        free = angle
        before[:] = d
        angle = min(angle + step, end)
    _move_finger(hand, finger, held, free, base, q, R, t)
    nearest = held
    for k in range(held + 1, n):
        if d[k] <= d[nearest]:
            nearest = k
    return free, nearest


@njit(allocates=False)
def _first_row(hand, finger, joints, q, base, R, t):  # type: ignore[no-untyped-def]
    """The row in which a finger starts from `joints`, beyond its stops; fills q and base (D,)."""
    n = hand.finger_link.shape[1]
    row = hand.first[finger]
    base[:] = 0.0
    while hand.advances_at_stop and row + 1 < n:
        q[row] = joints[hand.finger_joint[finger, row]]
        if q[row] < hand.finger_upper[finger, row] - 1e-9:
            break
        place_link(hand, hand.finger_link[finger, row], q[row], R, t)
        row += 1
        start = hand.row_start[finger, row]
        for k in range(n):
            base[k] = start[k] - hand.closing_ratio[finger, row, k] * start[row]
    return row


@njit
def close_hand(hand, obj, joints, gap, R, t, work, other):  # type: ignore[no-untyped-def]
    """Close all fingers from `joints` (spread set, fingers open); `joints`, R and t follow.

    Returns the number of fingers that touch the object, or -1 where a finger that touches it
    runs into another one. A finger that finds nothing closes to its end, but not into the hand.
    """
    n_fingers, n = hand.finger_link.shape
    touching = 0
    touched = np.zeros(n_fingers, dtype=np.bool_)
    q = np.empty(n)
    base = np.empty(n)
    for finger in range(n_fingers):
        held = _first_row(hand, finger, joints, q, base, R, t)
        s = joints[hand.finger_joint[finger, held]]
        while held < n:
            s, link = _advance(hand, obj, finger, held, s, base, q, gap, R, t, work)
            _move_finger(hand, finger, held, s, base, q, R, t)
            touched[finger] = touched[finger] or link >= 0
            if link >= 0:
                held = link + 1
            elif hand.advances_at_stop and held + 1 < n:
                held += 1
            else:
                break
            if held < n:
                s = q[held]
                for k in range(held, n):
                    base[k] = q[k] - hand.closing_ratio[finger, held, k] * s
        touching += touched[finger]
        for k in range(hand.first[finger], n):
            joints[hand.finger_joint[finger, k]] = q[k]
    for finger in range(n_fingers):
        if touched[finger]:
            continue
        first = hand.first[finger]
        row = n - 1 if hand.advances_at_stop else first
        while finger_meets_hand(hand, finger, R, t, 1e-4, work, other):
            start = hand.row_start[finger, row]
            for k in range(first, n):
                base[k] = start[k] - hand.closing_ratio[finger, row, k] * start[row]
                q[k] = joints[hand.finger_joint[finger, k]]
            s = max(q[row] - 0.05 * hand.finger_unit[finger], start[row])
            _move_finger(hand, finger, row, s, base, q, R, t)
            for k in range(first, n):
                joints[hand.finger_joint[finger, k]] = q[k]
            if s <= start[row]:
                if row == first:
                    break
                row -= 1
    for finger in range(n_fingers):
        if touched[finger] and finger_meets_hand(hand, finger, R, t, 1e-5, work, other):
            return -1
    return touching
