"""How likely a grasp holds when the part is not quite where the estimate says.

The hand goes where the estimate sends it; the part is elsewhere by a perturbation. Seen from the
part the palm is off by the inverse, so every perturbation is one more attempt of the evaluator:
the fingers close from the pre-grasp, on whatever they meet. Two estimates of the mean over the
perturbations: sampled, and by the sigma points of the unscented transform (J. Nogueira et al.,
"Unscented Bayesian optimization for safe robot grasping", IROS 2016).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus, PostureEvaluator
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.surroundings.covariance import check_covariance
from gpis_grasp_planner.surroundings.uncertainty_settings import UncertaintySettings

Array = NDArray[np.float64]

_BATCH = 512


@dataclass(frozen=True)
class HoldEstimate:
    """What is expected of one grasp under the pose's uncertainty.

    Attributes
    ----------
    probability : float
        That the grasp holds: force closure above a threshold with two fingers, or a finger and
        the palm, in touch.
    standard_error : float
        Of the probability, from (held + 1) / (n + 2), so that it is not 0 where all n of a few
        samples hold. For sigma points n is the number of equally weighted points.
    expected_quality : float
        Mean epsilon; a miss counts 0.
    n : int
        Perturbations tried.
    """

    probability: float
    standard_error: float
    expected_quality: float
    n: int


def random_perturbations(covariance: Array, n: int, rng: np.random.Generator) -> Array:
    """Normal perturbations (n, 6) with the covariance, in its order."""
    return np.asarray(rng.standard_normal((n, 6)) @ covariance_root(covariance).T)


def sigma_points(covariance: Array, kappa: float) -> tuple[Array, Array]:
    """Perturbations (13, 6) and weights (13,) with the mean 0 and the covariance, exactly.

    The middle has weight kappa / (6 + kappa), the others 1 / (2 (6 + kappa)) each, at
    sqrt(6 + kappa) standard deviations along the covariance's axes.
    """
    reach = np.sqrt(6.0 + kappa) * covariance_root(covariance).T
    points = np.concatenate([np.zeros((1, 6)), reach, -reach])
    weights = np.full(13, 0.5 / (6.0 + kappa))
    weights[0] = kappa / (6.0 + kappa)
    return points, weights


def perturbed_palms(T_object_palm: Array, perturbations: Array) -> Array:
    """Palm poses (n, 4, 4) seen from the object, which is off by perturbations (n, 6).

    The true object is at ``T_world_estimate @ [exp(r), t]`` for a perturbation (t, r) in the
    estimate's axes, so that the palm is at its inverse times `T_object_palm`.
    """
    R_t = Rotation.from_rotvec(-perturbations[:, 3:]).as_matrix()
    shift = -(R_t @ perturbations[:, :3, None])[..., 0]
    return np.asarray(transform(R_t, shift) @ T_object_palm)


def rank_under_uncertainty(
    evaluator: PostureEvaluator,
    hand: HandDescription,
    grasps: Sequence[Grasp],
    covariance: ArrayLike,
    settings: UncertaintySettings,
    rng: np.random.Generator,
) -> tuple[list[int], list[HoldEstimate]]:
    """Rank grasps by the probability that they hold, then by expected quality.

    All grasps see the same perturbations, so that they differ by their merit rather than by
    their luck. About 2 ms per grasp and perturbation: the hand closes on the part where it lies and
    where the fingers draw it.

    Parameters
    ----------
    evaluator : PostureEvaluator
        Of the part, with the friction to be reckoned with.
    hand : HandDescription
    grasps : sequence of Grasp
    covariance : (6, 6) array
        In the object's axes (`covariance_in_object`) [m, rad].
    settings : UncertaintySettings
    rng : Generator
        Draws once for all grasps; not used by the sigma points.

    Returns
    -------
    order : list of int
        Indices of the grasps, best first.
    estimates : list of HoldEstimate
        In the order of `grasps`.

    Raises
    ------
    PoseError
        INVALID_COVARIANCE.
    """
    C = check_covariance(covariance)
    if settings.method == "unscented":
        perturbations, weights = sigma_points(C, settings.sigma_kappa)
    else:
        perturbations = random_perturbations(C, settings.samples, rng)
        weights = np.full(settings.samples, 1.0 / settings.samples)
    estimates = [
        estimate_hold(evaluator, hand, grasp, perturbations, weights, settings) for grasp in grasps
    ]
    order = sorted(
        range(len(grasps)),
        key=lambda i: (-estimates[i].probability, -estimates[i].expected_quality),
    )
    return order, estimates


def holds(attempts: Attempts, hand: HandDescription, min_epsilon: float) -> NDArray[np.bool_]:
    """Which attempts (B,) hold: force closure, and two fingers or a finger and the palm touch."""
    good = (attempts.status == AttemptStatus.GRASPED) & (attempts.epsilon > min_epsilon)
    finger_of = np.zeros(hand.n_links, dtype=np.int64)  # 0: the palm and what is fixed to it
    for number, finger in enumerate(hand.fingers, start=1):
        finger_of[list(finger.links)] = number
        if hand.link_friction_group[finger.knuckle_link] == "finger":
            finger_of[finger.knuckle_link] = number
    for i in np.flatnonzero(good):
        touching = finger_of[attempts.links[i, : attempts.n_contacts[i]].astype(np.intp)]
        good[i] = len(np.unique(touching)) >= 2
    return np.asarray(good)


def estimate_hold(
    evaluator: PostureEvaluator,
    hand: HandDescription,
    grasp: Grasp,
    perturbations: Array,
    weights: Array,
    settings: UncertaintySettings,
) -> HoldEstimate:
    """What is expected of a grasp under perturbations (n, 6) with weights (n,)."""
    held, quality = [], []
    on_palm = hand.link_names.index(hand.palm_link) in grasp.contacts.links
    for first in range(0, len(perturbations), _BATCH):
        T = perturbed_palms(grasp.T_object_palm, perturbations[first : first + _BATCH])
        attempts = close_disturbed(evaluator, T, grasp.pregrasp_joints, on_palm, settings)
        ok = holds(attempts, hand, settings.min_epsilon)
        held.append(ok)
        quality.append(np.where(ok, attempts.epsilon, 0.0))
    n = len(perturbations)
    probability = float(weights @ np.concatenate(held))
    middle = (probability * n + 1.0) / (n + 2.0)
    return HoldEstimate(
        probability=probability,
        standard_error=float(np.sqrt(middle * (1.0 - middle) / n)),
        expected_quality=float(weights @ np.concatenate(quality)),
        n=n,
    )


def close_disturbed(
    evaluator: PostureEvaluator,
    T_object_palm: Array,
    pregrasp_joints: Array,
    on_palm: bool,
    settings: UncertaintySettings,
) -> Attempts:
    """Close a hand from its pre-grasp (J,) where it comes to be beside the part, (n, 4, 4).

    A part that the open hand arrives in gives way, and one that was planned to touch the palm
    (`on_palm`) is drawn in by the fingers.
    """
    joints = np.repeat(pregrasp_joints[None], len(T_object_palm), axis=0)
    attempts = evaluator.attempt_from(np.array(T_object_palm), joints)
    if settings.give_way_m > 0.0:
        _give_way(evaluator, attempts, joints, settings.give_way_m)
    # Fingertips that hold a part away from the palm do not draw it in.
    if settings.draw_in_m > 0.0 and on_palm:
        _draw_in(evaluator, attempts, joints, settings.draw_in_m)
    return attempts


def _give_way(evaluator: PostureEvaluator, attempts: Attempts, joints: Array, reach: float) -> None:
    """Try the hands that arrived in the part again, as far back as the part is pushed along."""
    rows = np.flatnonzero(attempts.status == AttemptStatus.PALM_COLLISION)
    if not len(rows):
        return
    back = attempts.T_object_palm[rows]
    back[:, :3, 3] -= reach * back[:, :3, 2]
    touching, _ = evaluator.approach(back, joints[rows], reach)
    _put(attempts, rows, evaluator.attempt_from(touching, joints[rows]))


def _draw_in(evaluator: PostureEvaluator, attempts: Attempts, joints: Array, reach: float) -> None:
    """Try again with the part drawn against the palm, as closing fingers do; the better counts."""
    free = np.flatnonzero(attempts.status != AttemptStatus.PALM_COLLISION)
    if not len(free):
        return
    drawn, _ = evaluator.approach(attempts.T_object_palm[free], joints[free], reach)
    again = evaluator.attempt_from(drawn, joints[free])
    better = (again.status == AttemptStatus.GRASPED) & (again.epsilon > attempts.epsilon[free])
    _put(attempts, free[better], again, better)


def _put(
    attempts: Attempts,
    rows: NDArray[np.intp],
    again: Attempts,
    of: NDArray[np.bool_] | slice = slice(None),
) -> None:
    """Put (some of) other attempts into rows."""
    for name in ("T_object_palm", "status", "joints", "n_contacts", "positions", "normals_inward",
                 "friction", "links", "epsilon", "volume", "imbalance"):  # fmt: skip
        if getattr(attempts, name) is not None:
            getattr(attempts, name)[rows] = getattr(again, name)[of]


def covariance_root(covariance: Array) -> Array:
    """A square root (6, 6), also of a singular covariance: A A^T = covariance.

    Metres and radians have no common axes: the columns are those of the matrix scaled to unit
    variances, so that another unit of length does not turn the sigma points.
    """
    deviation = np.sqrt(np.diag(covariance))
    scale = np.where(deviation > 0.0, deviation, 1.0)
    values, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * axes * np.sqrt(np.maximum(values, 0.0)))
