"""Whether a placed hand collides with anything, compiled: the legal states of a posture search."""

from __future__ import annotations

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.scene.palm import hand_gap
from gpis_grasp_planner.scene.posture import finger_meets_hand

_OVERLAP = 1e-6
_LIMIT = 1e-4


@njit(allocates=False)
def hand_meets_itself(hand, R, t, work, other):  # type: ignore[no-untyped-def]
    """Whether a finger overlaps another one or the palm."""
    for finger in range(hand.finger_link.shape[0]):
        if finger_meets_hand(hand, finger, R, t, _OVERLAP, work, other):
            return True
    return False


@njit(allocates=False)
def hand_is_free(hand, obj, R, t, work, other):  # type: ignore[no-untyped-def]
    """Whether a placed hand collides neither with the object nor with itself."""
    if hand_gap(hand, obj, R, t, _LIMIT, work) <= 0.0:
        return False
    return not hand_meets_itself(hand, R, t, work, other)
