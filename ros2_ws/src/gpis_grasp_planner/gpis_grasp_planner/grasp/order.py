"""The order of grasps: how far apart two are, which are distinct, which is answered first.

Two grasps are distinct if ``max(translation / maxRadius, angle / 2 pi)`` of their palm poses is at
least 0.2, the rule by which the original simulator keeps its list of 20; otherwise a mean over
20 grasps would be a mean over one grasp and its neighbours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.transforms import rotation_angle
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.quality.objective import Objective, worth
from gpis_grasp_planner.quality.surface_knowledge import SURFACE_HOLD

Array = NDArray[np.float64]

DISTINCT = 0.2

# Of probabilities to hold: steps within which grasps are equal, and what one is multiplied by
# where the closing hand pushes the part by 5 mm or 5 degrees, and where the grasp fell though
# the part lay where it was planned.
_RESOLUTION = 0.05
_PUSHED = 0.8
_UNSTEADY = 0.85


def pose_difference(T_1: Array, T_2: Array, max_radius: float) -> Array:
    """``max(translation / maxRadius, angle / 2 pi)`` between poses (..., 4, 4)."""
    translation = np.linalg.norm(T_1[..., :3, 3] - T_2[..., :3, 3], axis=-1) / max_radius
    angle = rotation_angle(T_1[..., :3, :3], T_2[..., :3, :3]) / (2.0 * np.pi)
    return np.maximum(translation, angle)


def are_near(
    T_1: Array, T_2: Array, max_radius: float, apart: float = DISTINCT
) -> NDArray[np.bool_]:
    """Whether ``pose_difference < apart`` between all of (k, 4, 4) and all of (m, 4, 4): (k, m).

    By two matrix products, with the rule for the angle as one for the trace of ``R_1^T R_2``.
    """
    offset = T_1[:, None, :3, 3] - T_2[None, :, :3, 3]
    near = np.einsum("kmi,kmi->km", offset, offset) < (apart * max_radius) ** 2
    angle = 2.0 * np.pi * apart
    if angle <= np.pi:
        trace = T_1[:, :3, :3].reshape(-1, 9) @ T_2[:, :3, :3].reshape(-1, 9).T
        near &= trace > 1.0 + 2.0 * np.cos(angle)
    return np.asarray(near)


def distinct(
    T: Array, order: NDArray[np.intp], max_radius: float, n: int, apart: float = DISTINCT
) -> list[int]:
    """Greedy choice of up to `n` poses from `order`, each `apart` from all chosen before."""
    chosen: list[int] = []
    left = np.asarray(order)
    while len(left) and len(chosen) < n:
        chosen.append(int(left[0]))
        left = left[1:]
        left = left[~are_near(T[left], T[chosen[-1:]], max_radius, apart)[:, 0]]
    return chosen


def answer_rank(grasp: Grasp, objective: Objective) -> tuple[float, ...]:
    """Sort key of an answer's grasps, best first.

    Grasps that physics held come before untried ones, and those before grasps that failed. Within
    each, the likelier to hold by `hold_estimate` comes first; a hand that pushes the part away
    while it closes counts as less likely, and so does a grasp that another engine or the hardest
    friction and mass let fall; differences that a dozen trials cannot show are none. Then the
    likelier to hold under the pose's covariance by the contact model, of a part that was scanned
    on more of the surfaces drawn for it, then what the objective makes of it.
    """
    tried = 0 if grasp.trials is None else (1 if grasp.trials.held else -1)
    probability = 0.0 if grasp.hold_estimate is None else grasp.hold_estimate.probability
    if tried > 0 and grasp.trials is not None:
        probability *= 1.0 if grasp.trials.gentle else _PUSHED
        probability *= 1.0 if grasp.trials.steady else _UNSTEADY
    surface = grasp.quality.measured.get(SURFACE_HOLD.name, 1.0)
    return (
        -float(tried),
        -float(round(probability / _RESOLUTION)),
        -(grasp.hold_probability or 0.0),
        -surface,
        -_worth(grasp, objective),
    )


def _worth(grasp: Grasp, objective: Objective) -> float:
    """What the objective makes of its figures, and the arm's worth."""
    value = float(worth(objective, grasp.quality))
    return value if grasp.arm is None else value + grasp.arm.worth
