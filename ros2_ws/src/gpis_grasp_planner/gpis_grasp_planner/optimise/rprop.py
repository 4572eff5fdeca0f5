"""iRprop-: ascent by the signs of the gradient (paper, section III: RProp on the likelihood).

C. Igel, M. Huesken: Empirical evaluation of the improved Rprop learning algorithms (2003); used
for Gaussian processes by M. Blum, M. Riedmiller (2013).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.settings import SettingsGroup, setting

Array = NDArray[np.float64]


@dataclass(frozen=True)
class RpropSettings(SettingsGroup):
    """Parameters of iRprop-."""

    step_start: float = setting(0.2, low=1e-6, high=10.0, description="First step of a coordinate.")
    step_min: float = setting(1e-4, low=1e-12, high=1.0, description="Smallest step.")
    step_max: float = setting(1.0, low=1e-6, high=100.0, description="Largest step.")
    grow: float = setting(1.2, low=1.0, high=5.0, description="Growth while the sign stays.")
    shrink: float = setting(0.5, low=0.01, high=0.99, description="Shrink where the sign turns.")
    max_iterations: int = setting(40, low=1, high=10000, description="Limit of gradients.")
    gradient_tolerance: float = setting(
        1e-3, low=0.0, high=1.0, description="Stop when no free component is larger."
    )


@dataclass(frozen=True)
class RpropResult:
    """Best point seen: x (n,), value there, number of gradients, and whether it converged."""

    x: Array
    value: float
    iterations: int
    converged: bool


def maximise_rprop(
    function: Callable[[Array], tuple[float, Array]],
    start: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    settings: RpropSettings | None = None,
) -> RpropResult:
    """Maximise a differentiable function over a box.

    Parameters
    ----------
    function : callable
        x (n,) -> (value, gradient (n,)). A value that is not finite counts as infinitely bad.
    start, low, high : (n,) array_like
        For scale parameters hand in logarithms.

    Returns
    -------
    RpropResult
        Never worse than the start.
    """
    settings = settings or RpropSettings()
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    x = np.clip(np.array(start, dtype=float), low, high)
    if x.shape != low.shape or x.shape != high.shape or np.any(low > high):
        raise RequestError(
            f"Start {x.shape}, low {low.shape} and high {high.shape} must be of one shape "
            "with low <= high."
        )
    step = np.full(x.shape, settings.step_start)
    previous = np.zeros_like(x)
    best_x, best_value = x.copy(), -np.inf
    for iteration in range(1, settings.max_iterations + 1):
        value, gradient = function(x)
        gradient = np.where(np.isfinite(gradient), gradient, 0.0)
        if np.isfinite(value) and value > best_value:
            best_x, best_value = x.copy(), float(value)
        free = ~(((x <= low) & (gradient < 0)) | ((x >= high) & (gradient > 0)))
        if np.all(np.abs(gradient[free]) <= settings.gradient_tolerance):
            return RpropResult(best_x, best_value, iteration, converged=True)
        turn = previous * gradient
        step = np.where(turn > 0, np.minimum(step * settings.grow, settings.step_max), step)
        step = np.where(turn < 0, np.maximum(step * settings.shrink, settings.step_min), step)
        # The "minus" of iRprop-: after a turn the component rests once, without backtracking.
        gradient = np.where(turn < 0, 0.0, gradient)
        x = np.clip(x + np.sign(gradient) * step, low, high)
        previous = gradient
    return RpropResult(best_x, best_value, settings.max_iterations, converged=False)
