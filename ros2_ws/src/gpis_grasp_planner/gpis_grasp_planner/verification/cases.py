"""Which trials a finalist has to go through, from the one that decides to those beyond it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.grasp.trials import DISPLACED, TrialOutcome
from gpis_grasp_planner.verification.engines import engine_names, second_engines
from gpis_grasp_planner.verification.pose_noise import noise_displacements
from gpis_grasp_planner.verification.result import Verification
from gpis_grasp_planner.verification.settings import VerificationSettings

Array = NDArray[np.float64]

LEAST_KG = 1e-3


@dataclass(frozen=True, eq=False)
class TrialCase:
    """One trial by the strict protocol: its name, its settings, and where the part lies.

    `displacement` (4, 4) is that of :meth:`Verifier.verify_displaced`; None: where it was planned.
    `surface` is the one of `Part.drawn` that is tried; None: the part as it was planned on.
    """

    name: str
    settings: VerificationSettings
    displacement: Array | None = None
    surface: int | None = None

    def outcome(self, verdict: Verification) -> TrialOutcome:
        """What a verdict over a grasp in this case says, as answers carry it."""
        return TrialOutcome(
            self.name,
            verdict.held,
            verdict.cause,
            1e-3 * verdict.largest_slip_mm,
            float(np.radians(verdict.largest_rotation_deg)),
            verdict.closing_slip_m,
            verdict.closing_rotation_rad,
        )


def cad_mass(part: Part, settings: VerificationSettings) -> float:
    """Mass [kg] of the part, or the protocol's where the hand could not carry the part.

    A part lighter than 1 g counts as 1 g.
    """
    return max(part.mass, LEAST_KG) if part.mass <= settings.payload_kg else settings.mass_kg


def finalist_cases(
    part: Part,
    friction: Friction,
    settings: VerificationSettings,
    seed: int,
    covariance: Array | None = None,
) -> Sequence[TrialCase]:
    """The case that decides whether a grasp holds, and those that say how probably it does.

    The first is the strict protocol at the settings' friction, or at the friction that was planned
    with where that is less, of fingers and palm each. The others are a sample of what may be met in
    the cell, the same for every grasp, so that grasps differ by what they are and not by their
    luck. Their friction is one of fingers and palm, unless the settings have a palm's share: what
    is drawn is no longer what the material's table says.

    - draws: friction uniform between `low_friction` and `high_friction` (both less where the
      first case has less than the settings' friction), mass log-uniform from `mass_kg` to
      the part's own, the part displaced by `pose_noise_m` and `pose_noise_deg`, or by the
      covariance (6, 6) of the pose in the object's axes where that is known. They are
      :func:`spread_points`, so that any first few of them are spread well. Of a part that was
      scanned each is made on the next of the surfaces drawn for it;
    - after the second draw the first case in the other physics engine, where the settings leave the
      engine open and there is another, for a verdict should not be one engine's habit;
    - last, its corner: slippery fingers and the part's own mass. Earlier it would make grasps
      that were tried a little look worse than those that were not.

    Returns
    -------
    sequence of TrialCase
        `draws` + 2 or + 3 of them.
    """
    nominal = replace(settings, friction=min(settings.friction, friction.finger))
    if nominal.friction > 0.0:
        of_palm = min(settings.palm_friction_share * settings.friction, friction.palm)
        nominal = replace(nominal, palm_friction_share=of_palm / nominal.friction)
    less = nominal.friction / settings.friction if settings.friction > 0.0 else 1.0
    low, high = less * settings.low_friction, less * settings.high_friction
    mass, n_surfaces = cad_mass(part, settings), len(part.drawn)
    share = settings.palm_friction_share
    corner = replace(nominal, friction=low, palm_friction_share=share, mass_kg=mass)
    others = []
    points = spread_points(settings.draws, 8, np.random.default_rng(seed))
    moves = noise_displacements(ndtri(points[:, 2:]), part, settings, covariance)
    for k, ((u_friction, u_mass), move) in enumerate(zip(points[:, :2], moves, strict=True)):
        drawn = replace(
            nominal,
            friction=low + u_friction * (high - low),
            palm_friction_share=share,
            mass_kg=settings.mass_kg * (mass / settings.mass_kg) ** u_mass,
        )
        name, surface = f"{_name(drawn)}{DISPLACED} {k + 1}", None
        if n_surfaces:
            surface = k % n_surfaces
            name += f", surface {surface + 1}"
        others.append(TrialCase(name, drawn, move, surface))
    others[2:2] = [
        TrialCase(_name(other), other)
        for other in (replace(nominal, engine=name) for name in second_engines(settings.engine))
    ]
    others.append(TrialCase(_name(corner), corner))
    return [TrialCase(_name(nominal), nominal), *others]


def spread_points(n: int, dimensions: int, rng: np.random.Generator) -> Array:
    """Points (n, dimensions) in the open unit cube, of which any first few are spread evenly.

    Latin hypercubes that double: of the first 1, 2, 4, 8, ... points one lies in each of as many
    equal intervals of every axis, in an order by chance. Each point is uniform, and the first
    points are the same whatever n is.
    """
    points = rng.random((1, dimensions))
    while len(points) < n:
        intervals = np.arange(2 * len(points))
        taken = (points * len(intervals)).astype(int)
        free = [rng.permutation(np.setdiff1d(intervals, column)) for column in taken.T]
        fresh = (np.stack(free, axis=1) + rng.random(points.shape)) / len(intervals)
        points = np.concatenate([points, fresh])
    return np.clip(points[:n], 1e-9, 1.0 - 1e-9)


def _name(settings: VerificationSettings) -> str:
    engines = " and ".join(engine_names(settings.engine))
    of_palm = settings.palm_friction_share * settings.friction
    palm = "" if settings.palm_friction_share == 1.0 else f" (palm {of_palm:g})"
    return f"friction {settings.friction:g}{palm}, {settings.mass_kg:.3g} kg, {engines}"
