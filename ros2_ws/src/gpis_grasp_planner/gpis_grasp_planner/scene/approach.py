"""Moving a hand along its palm's axis until it touches the object, compiled."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.hand.link_mesh import MOST_CORNERS
from gpis_grasp_planner.scene.palm import hand_gap
from gpis_grasp_planner.scene.posture import exact_gap, place_hand

_STEPS = 60


@njit
def approach_many(hand, obj, T, joints, reach, gap, threshold, palm_touches):  # type: ignore[no-untyped-def]
    """Advance free hands along the palm's z axis, in place in T, by at most `reach` [m].

    A hand stops with a gap where its first link touches; `palm_touches` tells whether the palm
    is one of those within `threshold`.
    """
    n_links = hand.parent.shape[0]
    R = np.empty((n_links, 3, 3))
    t = np.empty((n_links, 3))
    work = np.empty((MOST_CORNERS, 3))
    for b in range(T.shape[0]):
        moved = 0.0
        touches = False
        for _ in range(_STEPS):
            place_hand(hand, joints[b], T[b], R, t)
            d = hand_gap(hand, obj, R, t, reach, work)
            touches = d < 2.0 * gap
            if touches or moved >= reach:
                break
            step = min(d - gap, reach - moved)
            moved += step
            for a in range(3):
                T[b, a, 3] += step * T[b, a, 2]
        palm_touches[b] = exact_gap(hand, obj, 0, R, t, threshold, work) < threshold
