"""Local adaption on the GPIS atlas (Alg. 2): palms parallel to a chart, moved until free.

For a proposed palm pose the nearest surface point and its chart are found; `n_seed` points of the
chart then each get a palm whose z axis points against the chart's outward normal, moved along
the normal until the open hand is free, and the hand is closed.

Departures from the paper, each for a reason:

- The palm's z is turned *against* the outward normal by the smallest rotation (the paper's text
  turns it onto the normal), so that the proposed rotation decides the roll about it.
- Beside the place on the chart every seed draws the hand's spread and a standoff. AutoGrasp keeps
  the spread, so that nothing else in the first stage would choose it; and a hand that always
  goes as near as it can never grasps with its fingertips. The first seed is the paper's own: the
  chart's centre, no standoff.
- lambda and theta_z start anew for every seed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.planning.evaluator import Attempts, GraspEvaluator
from gpis_grasp_planner.settings import SettingsGroup, setting
from gpis_grasp_planner.surface.atlas import SurfaceAtlas

if TYPE_CHECKING:
    from gpis_grasp_planner.planning.context import PlanningContext

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AdaptionSettings(SettingsGroup):
    """Parameters of the local adaption."""

    n_seed: int = setting(
        12, low=1, high=1000, description="n_seed of Alg. 2: points tried on each chart."
    )
    chart_radius_ratio: float = setting(
        0.15,
        low=0.0,
        high=1.0,
        description="Radius of u_rand on the chart, over the object's largest radius.",
    )
    standoff_max_m: float = setting(
        0.09,
        low=0.0,
        high=0.3,
        description="Seeds go back from the nearest free palm by up to this.",
    )
    standoff_share: float = setting(
        0.6, low=0.0, high=1.0, description="Share of the seeds that go back at all."
    )
    spread_max_deg: float = setting(
        180.0, low=0.0, high=180.0, description="Largest spread that seeds draw."
    )


class LocalAdaption:
    """GPISAtlas() of Alg. 2 for many proposals at once.

    Parameters
    ----------
    evaluator : GraspEvaluator
    atlas : SurfaceAtlas
    T_palm_face : (4, 4) array
        Pose of the palm's face in the palm frame: the face is what is laid on the chart.
    max_radius : float [m]
        The object's largest radius.
    settings : AdaptionSettings
    """

    def __init__(
        self,
        evaluator: GraspEvaluator,
        atlas: SurfaceAtlas,
        T_palm_face: Array,
        max_radius: float,
        settings: AdaptionSettings,
    ):
        self.evaluator = evaluator
        self.atlas = atlas
        self.settings = settings
        self.T_palm_face = T_palm_face
        self._face_height = float(T_palm_face[2, 3])
        self._radius = settings.chart_radius_ratio * max_radius

    @classmethod
    def of(cls, context: PlanningContext) -> LocalAdaption:
        """The adaption of a planning context."""
        return cls(
            context.evaluator,
            context.atlas,
            context.T_palm_face,
            context.max_radius,
            context.settings.adaption,
        )

    def __call__(
        self, T_object_face: Array, rng: np.random.Generator
    ) -> tuple[Attempts, NDArray[np.int64]]:
        """Adapt proposals (k, 4, 4) of the palm's face.

        Returns
        -------
        attempts : Attempts
            Of all seeds whose hand came free.
        proposal : (B,) int array
            Which proposal each attempt belongs to.
        """
        n_seed = self.settings.n_seed
        index, _ = self.atlas.nearest(T_object_face[:, :3, 3])
        poses, normals, owner = [], [], []
        for k, nearest in enumerate(index):
            try:
                chart = self.atlas.chart(int(nearest))
            except MeshError:
                continue
            u = _disc(n_seed, self._radius, rng)
            center = chart.points(u)
            R = palm_against(T_object_face[k, :3, :3], chart.normal_outward)
            origin = center + self._face_height * chart.normal_outward
            poses.append(transform(np.broadcast_to(R, (n_seed, 3, 3)), origin))
            normals.append(np.broadcast_to(chart.normal_outward, (n_seed, 3)))
            owner.append(np.full(n_seed, k))
        if not poses:
            empty = np.zeros((0, 4, 4))
            return self.evaluator.attempt(empty, np.zeros(0)), np.zeros(0, dtype=np.int64)
        proposal = np.concatenate(owner)
        spread, standoff = self._posture(len(proposal), rng)
        T, free = self.evaluator.clear_palm(
            np.concatenate(poses), np.concatenate(normals), spread, standoff
        )
        return self.evaluator.attempt(T[free], spread[free]), proposal[free]

    def _posture(self, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
        s = self.settings
        spread = np.deg2rad(rng.uniform(0.0, s.spread_max_deg, n))
        # Half of the hands start with the fingers opposed or evenly around: good guesses.
        favourite = rng.random(n) < 0.5
        spread[favourite] = rng.choice([0.0, np.pi / 6, np.pi / 3, np.pi / 2], favourite.sum())
        spread = np.minimum(spread, np.deg2rad(s.spread_max_deg))
        standoff = np.where(
            rng.random(n) < s.standoff_share, rng.uniform(0.0, s.standoff_max_m, n), 0.0
        )
        standoff[:: s.n_seed] = 0.0
        return spread, standoff


def palm_against(R: Array, normal_outward: Array) -> Array:
    """Turn a rotation (3, 3) by the smallest angle so that its z axis is ``-normal_outward``."""
    z = R[:, 2]
    target = -normal_outward
    axis = np.cross(z, target)
    sine = np.linalg.norm(axis)
    angle = np.arctan2(sine, z @ target)
    if sine < 1e-12:
        if z @ target > 0.0:
            return np.asarray(R)
        axis, sine = R[:, 0], 1.0
        angle = np.pi
    x, y, w = axis / sine
    K = np.array([[0.0, -w, y], [w, 0.0, -x], [-y, x, 0.0]])
    return np.asarray((np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)) @ R)


def _disc(n: int, radius: float, rng: np.random.Generator) -> Array:
    """Points (n, 2) in a disc, the first one its centre."""
    r = radius * np.sqrt(rng.random(n))
    a = rng.uniform(0.0, 2.0 * np.pi, n)
    u = np.stack([r * np.cos(a), r * np.sin(a)], axis=1)
    u[0] = 0.0
    return u
