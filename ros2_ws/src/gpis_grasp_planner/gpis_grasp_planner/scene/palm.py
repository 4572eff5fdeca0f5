"""Bringing the open hand to the object, compiled: collision check, ladder, approach.

The search for a palm pose without collision is lines 7 to 17 of the paper's Alg. 2: along the
chart's normal the distance lambda grows in steps until the open hand is free, and where
lambda_max does not free it, the hand turns about the normal in steps. Departures: lambda and
theta_z start anew for every seed (the paper does not reset them); rungs that the distance field
proves to be in collision are passed over; and the last step is refined by advancing to contact,
since a palm that stops up to a whole step before the surface never touches it.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.scene.posture import (
    coarse_gap,
    exact_gap,
    far_from_field,
    place_hand,
    surely_free,
)


@njit
def hand_gap(hand, obj, R, t, limit, work):  # type: ignore[no-untyped-def]
    """Distance of all links from the object [m], at most `limit`; negative estimate inside.

    The links that are probably nearest come first: they spare the others their exact distance.
    """
    n_links = hand.parent.shape[0]
    at_least = np.empty(n_links)
    worst = np.inf
    for link in range(n_links):
        d = coarse_gap(hand, obj, link, R, t)
        if d < -0.7 * obj.spacing:
            return d
        worst = min(worst, d)
        at_least[link] = surely_free(hand, obj, link, d)
    best = limit
    for _ in range(n_links):
        link = int(np.argmin(at_least))
        if at_least[link] >= best:
            break
        at_least[link] = np.inf
        d = exact_gap(hand, obj, link, R, t, best, work)
        if d <= 0.0:
            return min(worst, 0.0)
        best = min(best, d)
    return best


@njit
def clear_palm(hand, obj, T, normal, joints, step, reach, turn, gap, standoff, R, t, work):  # type: ignore[no-untyped-def]
    """Move the open hand along `normal` until it is free (Alg. 2), in place in T.

    Parameters
    ----------
    T : (4, 4) array, in and out
        Palm pose at lambda = 0.
    normal : (3,) array
        Outward normal of the chart.
    joints : (J,) array
        Posture of the open hand.
    step, reach : float [m]
        Delta lambda and lambda_max.
    turn : float [rad]
        Delta theta_z.
    gap : float [m]
        Gap to leave where the hand is advanced to contact.
    standoff : float [m]
        Distance to go back from the refined position.

    Returns
    -------
    bool
        Whether a free pose was found.
    """
    x, y, z = T[0, 3], T[1, 3], T[2, 3]
    level = 0.0
    turned = 0.0
    d = 0.0
    while True:
        T[0, 3] = x + level * normal[0]
        T[1, 3] = y + level * normal[1]
        T[2, 3] = z + level * normal[2]
        place_hand(hand, joints, T, R, t)
        d = hand_gap(hand, obj, R, t, step, work)
        if d > 0.0:
            break
        if level < reach:
            # a point at depth d needs at least d to come free: rungs below that are skipped
            rungs = max(1.0, np.floor((-d - obj.spacing) / step))
            level = min(level + rungs * step, reach)
        else:
            turned += turn
            if turned >= 2.0 * np.pi:
                return False
            c = np.cos(turn)
            s = np.sin(turn)
            for a in range(3):
                u = T[a, 0]
                v = T[a, 1]
                T[a, 0] = c * u + s * v
                T[a, 1] = -s * u + c * v
    if level > 0.0:
        for _ in range(12):
            if d < 2.0 * gap:
                break
            advance = d - gap
            for a in range(3):
                T[a, 3] -= advance * normal[a]
            place_hand(hand, joints, T, R, t)
            d = hand_gap(hand, obj, R, t, step, work)
            if d <= 0.0:
                for a in range(3):
                    T[a, 3] += (advance + gap) * normal[a]
                break
    if standoff <= 0.0 and d > 0.0:
        return True
    for a in range(3):
        T[a, 3] += standoff * normal[a]
    place_hand(hand, joints, T, R, t)
    return hand_gap(hand, obj, R, t, step, work) > 0.0


@njit
def retreat_is_free(hand, obj, T, joints, distance, steps, R, t):  # type: ignore[no-untyped-def]
    """Whether the open hand can go back along the palm's -z by `distance` without touching."""
    back = T.copy()
    for k in range(1, steps + 1):
        for a in range(3):
            back[a, 3] = T[a, 3] - distance * k / steps * T[a, 2]
        place_hand(hand, joints, back, R, t)
        for link in range(hand.parent.shape[0]):
            if far_from_field(hand, obj, link, R, t):
                continue
            if coarse_gap(hand, obj, link, R, t) < -0.5 * obj.spacing:
                return False
    return True
