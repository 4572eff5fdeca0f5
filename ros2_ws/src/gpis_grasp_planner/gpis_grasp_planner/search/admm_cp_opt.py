"""ADMM-CP-Opt (Alg. 3): contact points optimised over the hand's motor angles.

For a palm on its chart the motors' angles q (pre-shape and fingers, those that move; the Barrett's
are four) maximise the quality of the contacts subject to every contact lying on the implicit
surface within the contact threshold::

    max  f_obj(q) - g_c(z)   s.t.  q = z,   q, z in the motors' box

    g_c(z) = mu sum_k max(0, |f_GPIS(c_k(z))| - eps_c)^2

f_obj is the quality that the finger links' points nearest to the surface would have as contacts
(with the normal of the GPIS there), whether or not they touch; g_c is what makes them touch. Both
sub-problems are solved by Bayesian optimisation, warm over the iterations.

Settled here (see also `optimise.admm` for the signs):

- Only the excess over the threshold is a violation; the paper squares |f| - eps_c, which also
  punishes points well inside it.
- The motors' angles are scaled to [0, 1], so that rho and the tolerances mean the same for the
  pre-shape and the fingers; violations are counted in millimetres.
- q and z stay in a neighbourhood of the grasp they start from. In the motors' whole box fingers
  that touch are so rare that the few evaluations a sub-problem has find nothing but the start
  (on a ball 5 of 6 runs ended where they began; in the neighbourhood 2 of 10).
- The under-actuated hand is respected: an inner link stops at the object and is freed
  (breakaway), the distal link follows coupling and breakaway (`evaluator.postures`).
- The answer of ADMM is realised by closing the hand with the optimised pre-shape at the shifted
  palm. What enters the archive is that real grasp, never the relaxed posture; a run that did not
  converge is reported as such.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.grasp.evaluator import Attempts, Postures
from gpis_grasp_planner.hand.drive import motors_from_joints
from gpis_grasp_planner.optimise.admm import AdmmResult, AdmmSettings, solve_admm
from gpis_grasp_planner.optimise.bayesian import BayesianSettings
from gpis_grasp_planner.optimise.bayesian_subproblem import BayesianSubproblem, SubproblemSettings
from gpis_grasp_planner.optimise.domain import BoxDomain
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.fast_epsilon import fast_epsilon, start_directions
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.quality.measure import HeldPart
from gpis_grasp_planner.quality.measures import measured
from gpis_grasp_planner.quality.volume_estimate import volume_estimate
from gpis_grasp_planner.search.context import PlanningContext, posture_evaluator

Array = NDArray[np.float64]

_DIRECTIONS = start_directions(256)
_STARTS = 8


@dataclass(frozen=True, eq=False)
class CpOptResult:
    """One seed of ADMM-CP-Opt with its evidence.

    Attributes
    ----------
    T_object_palm : (4, 4) array
        The shifted palm.
    motors : (S + F,) array [rad]
        Optimised pre-shape and finger motors (the consensus z).
    admm : AdmmResult
        Iterates and residuals, in motors scaled to [0, 1].
    violation_m : float
        Largest excess of |f_GPIS| over the threshold at the answer's contact points.
    realised : Attempts
        The hand closed at that palm with that pre-shape (one attempt).
    """

    T_object_palm: Array
    motors: Array
    admm: AdmmResult
    violation_m: float
    realised: Attempts

    @property
    def converged(self) -> bool:
        """Whether both residuals met their tolerances; also where the start stayed the best."""
        return self.admm.converged


class ContactPointOptimiser:
    """Alg. 3 for palms of a planning context."""

    def __init__(self, context: PlanningContext):
        self._context = context
        self.settings = context.settings.admm
        self._evaluator = posture_evaluator(context)
        self._lower = context.hand.motor_lower
        self._width = context.hand.motor_upper - self._lower
        self._moving = np.flatnonzero(self._width > 0.0)

    def optimise(
        self,
        T_object_palm: Array,
        joints: Array,
        should_stop: Callable[[], bool] | None = None,
    ) -> list[CpOptResult]:
        """Optimise the contacts of a grasp; realised grasps go into the context's archive.

        Parameters
        ----------
        T_object_palm : (4, 4) array
        joints : (J,) array [rad]
            The grasp to start from.
        should_stop : callable, optional
            Asked before every iteration of ADMM.
        """
        c = self._context
        [preshape], [fingers] = motors_from_joints(c.hand, joints)
        start = self._scaled(np.concatenate([preshape, fingers]))
        results = []
        for n in range(self.settings.n_seed):
            if n and should_stop is not None and should_stop():
                break
            T = T_object_palm if n == 0 else self._shifted(T_object_palm)
            result = self._solve(T, start, should_stop)
            if result is not None:
                c.archive.add(result.realised)
                results.append(result)
        return results

    def quality(self, T_object_palm: Array, scaled_motors: Array) -> Array:
        """f_obj (B,) of scaled motors (B, m): quality of the nearest points taken as contacts."""
        postures = self._postures(T_object_palm, scaled_motors)
        return np.array(
            [self._posture_quality(T_object_palm, postures, b) for b in range(len(scaled_motors))]
        )

    def penalty(self, T_object_palm: Array, scaled_motors: Array) -> Array:
        """g_c (B,) of scaled motors (B, m)."""
        excess_mm = 1e3 * self.violations(T_object_palm, scaled_motors)
        return np.asarray(self.settings.penalty_per_mm2 * (excess_mm**2).sum(axis=1))

    def violations(self, T_object_palm: Array, scaled_motors: Array) -> Array:
        """Excess of |f_GPIS| over the contact threshold at the fingertips' points (B, F) [m]."""
        points = self._postures(T_object_palm, scaled_motors).points[:, :, 0]
        value = self._context.atlas.surface.value(points.reshape(-1, 3))
        threshold = self._context.settings.scene.contact_threshold_m
        return np.maximum(np.abs(value) - threshold, 0.0).reshape(points.shape[:2])

    def _solve(
        self, T: Array, start: Array, should_stop: Callable[[], bool] | None
    ) -> CpOptResult | None:
        s = self.settings
        rng = self._context.rng
        budget = SubproblemSettings(
            first_evaluations=s.first_evaluations, update_evaluations=s.update_evaluations
        )
        bayesian = BayesianSettings(n_initial=max(1, s.first_evaluations // 2))
        domain = BoxDomain(
            np.maximum(start - s.neighbourhood, 0.0), np.minimum(start + s.neighbourhood, 1.0)
        )
        solve_q = BayesianSubproblem(
            lambda X: self.quality(T, X), domain, budget, bayesian, seed=rng.spawn(1)[0]
        )
        solve_z = BayesianSubproblem(
            lambda X: -self.penalty(T, X), domain, budget, bayesian, seed=rng.spawn(1)[0]
        )
        admm = solve_admm(
            solve_q,
            solve_z,
            start,
            domain.lower,
            domain.upper,
            AdmmSettings(
                rho=s.rho,
                max_iterations=s.max_iterations,
                primal_tolerance=s.primal_tolerance,
                dual_tolerance=s.dual_tolerance,
            ),
            should_stop,
        )
        if admm.iterations == 0:
            return None
        motors = self._motors(admm.z[None])[0]
        return CpOptResult(
            T_object_palm=T,
            motors=motors,
            admm=admm,
            violation_m=float(self.violations(T, admm.z[None]).max()),
            realised=self._context.evaluator.attempt(
                T[None], motors[None, : len(self._context.hand.preshape)]
            ),
        )

    def _postures(self, T: Array, scaled_motors: Array) -> Postures:
        motors = self._motors(scaled_motors)
        n = len(motors)
        return self._evaluator.postures(np.broadcast_to(T, (n, 4, 4)), motors)

    def _posture_quality(self, T: Array, postures: Postures, b: int) -> float:
        c = self._context
        candidates = postures.points[b, :, 0]
        inner = postures.points[b, :, 1:][postures.inner_touches[b]]
        points = np.concatenate([candidates, inner])
        value, gradient = c.atlas.surface.value_and_gradient(points)
        length = np.linalg.norm(gradient, axis=1)
        near = (np.abs(value) <= 1e-3 * self.settings.contact_reach_mm) & (length > 1e-3)
        if np.count_nonzero(near) < 2:
            return 0.0
        on_surface = points[near] - (value[near] / length[near] ** 2)[:, None] * gradient[near]
        # A few millimetres off the surface f is that of the nearest sample, and its gradient up
        # to 20 degrees off; the normal is that of the surface.
        normals = c.atlas.surface.gradient(on_surface)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        contacts = Contacts(
            on_surface,
            -normals,
            np.full(len(normals), c.evaluator.friction.finger),
            np.zeros(len(normals), dtype=np.intp),
        )
        held = HeldPart(
            contacts,
            c.part.center_of_mass,
            c.max_radius,
            c.settings.scene.cone_edges,
            T,
            postures.joints[b],
        )
        W = held.wrenches
        epsilon = float(fast_epsilon(W, _DIRECTIONS, _STARTS))
        figures = measured(held, c.objective.measures) if epsilon > 0.0 else {}
        quality = Quality(epsilon, float(volume_estimate(W, len(contacts))), None, figures)
        return float(c.objective.value(quality))

    def _shifted(self, T: Array) -> Array:
        """The palm moved on the chart through it, which is parallel to the surface's chart."""
        c = self._context
        face = (T @ c.T_palm_face)[:3, 3]
        index, _ = c.atlas.nearest(face[None])
        try:
            basis = c.atlas.chart(int(index[0])).basis
        except MeshError:
            basis = T[:3, :2]
        u = self.settings.shift_ratio * c.max_radius * c.rng.uniform(-1.0, 1.0, 2)
        moved = T.copy()
        moved[:3, 3] += basis @ u
        return moved

    def _scaled(self, motors: Array) -> Array:
        """Those that move (m,), scaled to [0, 1]."""
        moved = (motors - self._lower)[self._moving] / self._width[self._moving]
        return np.clip(moved, 0.0, 1.0)

    def _motors(self, scaled: Array) -> Array:
        """All motors (B, S + F) [rad] of those that move, (B, m) in [0, 1]."""
        motors = np.tile(self._lower, (len(scaled), 1))
        width = self._width[self._moving]
        motors[:, self._moving] = self._lower[self._moving] + width * scaled
        return motors
