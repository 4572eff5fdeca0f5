"""How a grasp fares in the cases of the trials by the contact model alone, before it is tried.

In each case the hand is closed on the part where it lies then, with the case's friction, and what
is left unbalanced of the case's own push is what counts. That takes milliseconds where a trial in
physics takes tenths of a second, and it is the best that is known of how probably an untried grasp
holds (docs/benchmark/hold_prior): epsilon and balance where the part was planned do not say what
becomes of them a millimetre beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.transforms import inverse
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.open_hand import pregrasp_of
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.closing_balance import with_balance
from gpis_grasp_planner.plan.preparation import PreparedObject
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.balance_factor import CASE_BALANCE, balance_factor
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.archive import Candidate
from gpis_grasp_planner.surroundings.hold_probability import close_disturbed, holds
from gpis_grasp_planner.verification.cases import TrialCase

Array = NDArray[np.float64]

# With all twelve draws hardly more is known than with six.
_DRAWS = 6
_LEAST_EPSILON = 1e-3


class CaseBalance:
    """Knows the figure `case_balance` of grasps and candidates; what it has found it remembers.

    Parameters
    ----------
    part, hand, settings, prepared
    cases : sequence of TrialCase
        Of `finalist_cases`: the first draws and the last case are looked at.
    """

    def __init__(
        self,
        part: Part,
        hand: HandDescription,
        settings: PlannerSettings,
        prepared: PreparedObject,
        cases: Sequence[TrialCase],
    ):
        self._hand, self._settings = hand, settings.uncertainty
        self._palm = hand.link_names.index(hand.palm_link)
        self._known: dict[bytes, float] = {}
        draws = [case for case in cases if case.displacement is not None][:_DRAWS]
        self._cases = [
            (
                np.eye(4) if case.displacement is None else inverse(case.displacement),
                with_balance(
                    CompiledEvaluator(
                        hand,
                        part,
                        _friction(case),
                        settings.scene,
                        prepared.field,
                        prepared.tree,
                    ),
                    *(hand, part, settings, case.settings.mass_kg),
                ),
            )
            for case in (*draws, cases[-1])
        ]

    def judged(self, grasp: Grasp) -> Grasp:
        """The grasp with its `case_balance` (7 ms)."""
        on_palm = self._palm in grasp.contacts.links
        value = self._of(grasp.T_object_palm, grasp.pregrasp_joints, on_palm)
        figures = {**grasp.quality.measured, CASE_BALANCE.name: value}
        return replace(grasp, quality=replace(grasp.quality, measured=figures))

    def of_candidate(self, candidate: Candidate) -> float:
        """The figure of an attempt that was not finished."""
        attempts, i = candidate.attempts, candidate.index
        on_palm = self._palm in attempts.links[i, : attempts.n_contacts[i]]
        return self._of(candidate.T_object_palm, self._pregrasp(candidate), on_palm)

    def knows(self, candidate: Candidate) -> bool:
        """Whether :meth:`of_candidate` takes no time."""
        return _key(candidate.T_object_palm, self._pregrasp(candidate)) in self._known

    def _pregrasp(self, candidate: Candidate) -> Array:
        index = np.array([candidate.index])
        return np.asarray(pregrasp_of(candidate.attempts, index, self._hand)[0])

    def _of(self, T_object_palm: Array, pregrasp_joints: Array, on_palm: bool) -> float:
        key = _key(T_object_palm, pregrasp_joints)
        if key not in self._known:
            found = self._factors(T_object_palm, pregrasp_joints, on_palm)
            self._known[key] = float(np.mean(found))
        return self._known[key]

    def _factors(self, T_object_palm: Array, pregrasp_joints: Array, on_palm: bool) -> list[float]:
        """Of each case the balance factor, 0 where the closed hand has no force closure."""
        found = []
        for T_part_estimate, evaluator in self._cases:
            T = (T_part_estimate @ T_object_palm)[None]
            closed = close_disturbed(evaluator, T, pregrasp_joints, on_palm, self._settings)
            if not holds(closed, self._hand, _LEAST_EPSILON)[0]:
                found.append(0.0)
            elif closed.imbalance is None:
                found.append(1.0)
            else:
                found.append(float(balance_factor(closed.imbalance)[0]))
        return found


def _friction(case: TrialCase) -> Friction:
    of_fingers = case.settings.friction
    return Friction(of_fingers, case.settings.palm_friction_share * of_fingers)


def _key(T_object_palm: Array, pregrasp_joints: Array) -> bytes:
    return T_object_palm.tobytes() + pregrasp_joints.tobytes()
