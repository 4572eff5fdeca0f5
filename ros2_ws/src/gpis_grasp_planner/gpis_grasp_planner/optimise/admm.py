"""Alternating direction method of multipliers for a maximisation (paper, section III.B, Alg. 3).

The problem is

    max over q, z in a box of  f(q) - g(z)   subject to  q = z,

with the objective f and the penalty g >= 0 kept apart so that each gets a solver of its own.

**The paper's signs.** Printed there is max f + g_c, with +rho/2 |q - z + y/rho|^2 in both
sub-problems. A maximiser would then seek violations and run away from consensus: the form was
carried over from a minimisation. For a maximisation both are subtracted, and with

    L = f(q) - g(z) - y.(q - z) - rho/2 |q - z|^2

the sub-problems, after completing the square, are

    q <- argmax  f(q) - rho/2 |q - (z - y/rho)|^2
    z <- argmin  g(z) + rho/2 |z - (q + y/rho)|^2
    y <- y + rho (q - z)                                        (as printed)

which is Boyd et al. (2011), section 3.1, for the minimisation of -f. The multiplier y is the
unscaled one; u = y / rho is the scaled one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.settings import SettingsGroup, setting

Array = NDArray[np.float64]

Subproblem = Callable[[Array, float, Array], Array]
"""(centre (d,), rho, start (d,)) -> the point (d,) that is best with -rho/2 |x - centre|^2."""


@dataclass(frozen=True)
class AdmmSettings(SettingsGroup):
    """Parameters of ADMM."""

    rho: float = setting(1.0, low=1e-9, high=1e9, description="Weight of the consensus term.")
    max_iterations: int = setting(30, low=1, high=100000, description="Limit of iterations.")
    primal_tolerance: float = setting(
        1e-3, low=0.0, high=1e6, description="Converged when |q - z| is at most this ..."
    )
    dual_tolerance: float = setting(
        1e-3, low=0.0, high=1e6, description="... and rho |z - z_previous| at most this."
    )
    balance_ratio: float = setting(
        0.0,
        low=0.0,
        high=1e6,
        description="Balance rho when one residual exceeds the other by this factor; 0 is off.",
    )
    balance_factor: float = setting(
        2.0, low=1.0, high=100.0, description="Factor by which rho is balanced."
    )


class AdmmStatus(Enum):
    """Why the iteration ended; the value is a sentence for people."""

    CONVERGED = "Both residuals are within their tolerances."
    ITERATION_LIMIT = "The iteration limit was reached before the residuals met the tolerances."
    STOPPED = "The caller stopped the iteration (deadline or cancellation)."


@dataclass(frozen=True)
class AdmmResult:
    """End of the iteration and the evidence, one row per iteration in every history.

    Attributes
    ----------
    q, z, y : (d,) arrays
        Last iterates and multiplier.
    status : AdmmStatus
    primal_residuals, dual_residuals, rhos : (k,) arrays
        |q - z|, rho |z - z_previous|, and the rho of that iteration.
    q_history, z_history : (k, d) arrays
    z_start : (d,) array
        The z before the first iteration; with the histories it gives every residual again.

    Notes
    -----
    Converged says that the iteration has come to rest in consensus (Boyd et al., section 3.3), as
    far as its solvers can tell: one that samples may overlook a better point. Where neither
    solver finds anything better than a start without violation, the first iteration ends where it
    began, with both residuals zero: converged, and `moved` is False.
    """

    q: Array
    z: Array
    y: Array
    status: AdmmStatus
    primal_residuals: Array
    dual_residuals: Array
    rhos: Array
    q_history: Array
    z_history: Array
    z_start: Array

    @property
    def converged(self) -> bool:
        """Whether both residuals met their tolerances."""
        return self.status is AdmmStatus.CONVERGED

    @property
    def moved(self) -> bool:
        """Whether the answer z is another point than the start."""
        return bool((self.z != self.z_start).any())

    @property
    def iterations(self) -> int:
        """Number of completed iterations."""
        return len(self.rhos)

    def recomputed_residuals(self) -> tuple[Array, Array]:
        """Primal and dual residuals (k,) computed anew from the histories."""
        before = np.vstack([self.z_start[None], self.z_history])[:-1]
        primal = np.linalg.norm(self.q_history - self.z_history, axis=1)
        dual = self.rhos * np.linalg.norm(self.z_history - before, axis=1)
        return primal, dual


def solve_admm(
    solve_q: Subproblem,
    solve_z: Subproblem,
    start: ArrayLike,
    lower: ArrayLike,
    upper: ArrayLike,
    settings: AdmmSettings | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> AdmmResult:
    """Run ADMM from q = z = start, y = 0.

    Parameters
    ----------
    solve_q : callable
        (v, rho, start) -> argmax f(q) - rho/2 |q - v|^2 over the box.
    solve_z : callable
        (v, rho, start) -> argmin g(z) + rho/2 |z - v|^2 over the box.
    start, lower, upper : (d,) array_like
        Answers outside the box are clipped to it.
    should_stop : callable, optional
        Asked before every iteration.

    Returns
    -------
    AdmmResult
        Not converging is a status. Solvers may be inexact; the residuals tell.
    """
    settings = settings or AdmmSettings()
    lower, upper = np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    z_start = np.clip(np.asarray(start, dtype=float), lower, upper)
    if z_start.ndim != 1 or not z_start.shape == lower.shape == upper.shape:
        raise RequestError(
            f"Start {z_start.shape}, lower {lower.shape} and upper {upper.shape} must be vectors "
            "of one length."
        )
    q, z, y, rho = z_start.copy(), z_start.copy(), np.zeros_like(z_start), settings.rho
    qs: list[Array] = []
    zs: list[Array] = []
    residuals: list[tuple[float, float, float]] = []
    status = AdmmStatus.ITERATION_LIMIT
    for _ in range(settings.max_iterations):
        if should_stop is not None and should_stop():
            status = AdmmStatus.STOPPED
            break
        q = np.clip(solve_q(z - y / rho, rho, q), lower, upper)
        z_previous = z
        z = np.clip(solve_z(q + y / rho, rho, z), lower, upper)
        y = y + rho * (q - z)
        primal = float(np.linalg.norm(q - z))
        dual = float(rho * np.linalg.norm(z - z_previous))
        qs.append(q)
        zs.append(z)
        residuals.append((primal, dual, rho))
        if primal <= settings.primal_tolerance and dual <= settings.dual_tolerance:
            status = AdmmStatus.CONVERGED
            break
        rho = _balanced(rho, primal, dual, settings)
    table = np.array(residuals).reshape(-1, 3)
    return AdmmResult(
        q=q,
        z=z,
        y=y,
        status=status,
        primal_residuals=table[:, 0],
        dual_residuals=table[:, 1],
        rhos=table[:, 2],
        q_history=np.array(qs).reshape(-1, len(q)),
        z_history=np.array(zs).reshape(-1, len(q)),
        z_start=z_start,
    )


def _balanced(rho: float, primal: float, dual: float, settings: AdmmSettings) -> float:
    # Boyd et al. (2011), section 3.4.1. The unscaled multiplier needs no rescaling with rho.
    if settings.balance_ratio <= 0.0:
        return rho
    if primal > settings.balance_ratio * dual:
        return rho * settings.balance_factor
    if dual > settings.balance_ratio * primal:
        return rho / settings.balance_factor
    return rho
