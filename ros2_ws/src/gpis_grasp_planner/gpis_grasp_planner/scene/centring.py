"""A coupled hand brought to where all its fingers touch at one position, compiled.

The jaws of a gripper with one motor move by the same amount. Where one touches first, the part is
pushed, or the arm yields, until the other one touches too. A grasp that is planned shall not push
the part: so the palm is moved along the jaws' common line instead, until both touch at the same
time. The jaws stay where they are on the part; only palm and positions change.
"""

from __future__ import annotations

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.scene.palm import hand_gap
from gpis_grasp_planner.scene.posture import place_hand


@njit
def centre_hand(hand, obj, T, start, joints, threshold, R, t, work):  # type: ignore[no-untyped-def]
    """Move the palm T (4, 4) and the two jaws' `joints` so that both are closed alike, in place.

    Both jaws touch. Returns whether the open hand (`start`) and the closed one are free there.
    """
    first, second = hand.finger_joint[0, 0], hand.finger_joint[1, 0]
    link = hand.finger_link[0, 0]
    common = 0.5 * (joints[first] + joints[second])
    way = joints[first] - common
    for a in range(3):
        for b in range(3):
            T[a, 3] += way * R[link, a, b] * hand.axis[link, b]
    place_hand(hand, start, T, R, t)
    if hand_gap(hand, obj, R, t, threshold, work) <= 0.0:
        return False
    joints[first] = common
    joints[second] = common
    place_hand(hand, joints, T, R, t)
    return hand_gap(hand, obj, R, t, threshold, work) > 0.0
