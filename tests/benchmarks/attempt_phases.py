"""The phases of recorded attempts, each timed alone: collision, closing, contacts, epsilon.

A phase is the difference of two passes over the same hands, one of which ends after it. The last
pass gives the attempts' own epsilon; where it does not, the phases are not those of the planner
any more, and that is said.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.quality.fast_epsilon import fast_epsilon
from gpis_grasp_planner.quality.volume_estimate import volume_estimate
from gpis_grasp_planner.scene import grasp_kernel
from gpis_grasp_planner.scene.closing import close_hand
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.scene.free_hand import hand_meets_itself
from gpis_grasp_planner.scene.palm import hand_gap, retreat_is_free
from gpis_grasp_planner.scene.posture import place_hand
from gpis_grasp_planner.scene.touch import collect_contacts

PHASES = ("collision", "closing", "contacts", "epsilon, volume", "way back")
_MAX_CONTACTS = grasp_kernel.MAX_CONTACTS
_GOOD = grasp_kernel._GOOD
_pyramid_wrenches = grasp_kernel.pyramid_wrenches


@njit
def through(hand, obj, T, start, gap, threshold, edges, retreat, directions, starts, more, last,
            epsilon):  # fmt: skip
    """The first phases of every attempt, up to number `last`, as `grasp_kernel.attempt_from`."""
    n_links = hand.parent.shape[0]
    R, t = np.empty((n_links, 3, 3)), np.empty((n_links, 3))
    work, other = np.empty((512, 3)), np.empty((512, 3))
    wrenches = np.empty((_MAX_CONTACTS * edges, 6))
    positions, normals = np.empty((_MAX_CONTACTS, 3)), np.empty((_MAX_CONTACTS, 3))
    friction, links = np.empty(_MAX_CONTACTS), np.empty(_MAX_CONTACTS, dtype=np.int64)
    joints = np.empty(hand.n_joints)
    for b in range(T.shape[0]):
        epsilon[b] = -1.0
        for j in range(hand.n_joints):
            joints[j] = start[b, j]
        place_hand(hand, joints, T[b], R, t)
        if hand_gap(hand, obj, R, t, threshold, work) <= 0.0:
            continue
        if hand_meets_itself(hand, R, t, work, other) or last == 0:
            continue
        touching = close_hand(hand, obj, joints, gap, R, t, work, other)
        if touching <= 0 or last == 1:
            continue
        k = collect_contacts(hand, obj, R, t, threshold, work, positions, normals, links)
        if k < 2 or last == 2:
            continue
        for i in range(k):
            palm = hand.link_is_palm[links[i]]
            friction[i] = obj.friction_palm if palm else obj.friction_finger
        _pyramid_wrenches(obj, positions, normals, friction, k, edges, wrenches)
        W = wrenches[: k * edges]
        epsilon[b] = fast_epsilon(W, directions, starts, more, _GOOD)
        volume_estimate(W, k)
        if last == 3 or epsilon[b] <= 0.0:
            continue
        if not retreat_is_free(hand, obj, T[b], start[b], retreat, 6, R, t):
            epsilon[b] = -1.0


def seconds(evaluator: CompiledEvaluator, T: Any, start: Any, repeats: int = 3) -> dict[str, float]:
    """Processor time of each phase over the attempts at T (B, 4, 4) from `start` (B, J).

    The passes follow each other and are repeated; of each the least counts.
    """
    settings = evaluator.settings
    epsilon = np.empty(len(T))
    few, many = grasp_starts()
    arguments = (
        evaluator._hand, evaluator._object, np.array(T), np.array(start), settings.closing_gap_m,
        settings.contact_threshold_m, settings.cone_edges, settings.retreat_m,
        evaluator._directions, few, many - few,
    )  # fmt: skip
    through(*arguments, 0, epsilon)
    ends = np.full(len(PHASES), np.inf)
    for _ in range(repeats):
        for last in range(len(PHASES)):
            begin = time.thread_time()
            through(*arguments, last, epsilon)
            ends[last] = min(ends[last], time.thread_time() - begin)
    expected = evaluator.attempt_from(np.array(T), np.array(start)).epsilon
    if not np.array_equal(epsilon, expected):
        raise SystemExit("The phases timed here are not those of grasp_kernel.attempt_from.")
    return dict(zip(PHASES, np.diff(ends, prepend=0.0).tolist(), strict=True))


def grasp_starts() -> tuple[int, int]:
    """Starts of the hull-free epsilon, and of a good grasp's, as the evaluator asks for."""
    from gpis_grasp_planner.scene import compiled_evaluator

    return compiled_evaluator._STARTS, compiled_evaluator._STARTS_OF_GOOD
