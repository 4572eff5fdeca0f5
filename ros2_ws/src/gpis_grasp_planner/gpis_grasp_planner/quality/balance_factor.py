"""What an imbalance costs an objective; apart from its computation, which needs compiled code."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.quality.figures import Figure

Array = NDArray[np.float64]

CASE_BALANCE = Figure(
    "case_balance",
    "",
    True,
    "Mean, over cases of the trials (friction, mass and place drawn), of the share of an objective "
    "that the imbalance there leaves: 1 where all is balanced, 0 without force closure.",
    "`plan.case_balance`, docs/verification.md.",
)

# The factor where much is unbalanced, less than the share of such grasps that hold (a quarter,
# `docs/verification.md`), and the imbalance at which half of what is beyond it is lost.
_LEAST_FACTOR = 0.15
_HALF_AT = 0.2


def balance_factor(imbalance: ArrayLike) -> Array:
    """What an objective is multiplied by: 1 where all is balanced, down to 0.15."""
    lost = 1.0 / (1.0 + (np.asarray(imbalance) / _HALF_AT) ** 2)
    return _LEAST_FACTOR + (1.0 - _LEAST_FACTOR) * lost
