"""Local adaption on the GPIS atlas (Alg. 2): palms parallel to a chart, moved until free.

For a proposed palm pose the nearest surface point and its chart are found; `n_seed` points of the
chart then each get a palm whose z axis points against the chart's outward normal, moved along
the normal until the open hand is free, and the hand is closed.

Departures from the paper, each for a reason:

- The palm's z is turned *against* the outward normal by the smallest rotation (the paper's text
  turns it onto the normal), so that the proposed rotation decides the roll about it.
- Beside the place on the chart every seed draws the hand's pre-shape and a standoff. AutoGrasp
  keeps the pre-shape, so that nothing else in the first stage would choose it; and a hand that
  always goes as near as it can never grasps with its fingertips. The first seed is the paper's own:
  the chart's centre, no standoff.
- lambda and theta_z start anew for every seed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.evaluator import Attempts, GraspEvaluator
from gpis_grasp_planner.search.hand_fitting import HandFitting
from gpis_grasp_planner.search.preshape_range import PreshapeRange
from gpis_grasp_planner.search.settings import AdaptionSettings
from gpis_grasp_planner.surface.atlas import SurfaceAtlas

if TYPE_CHECKING:
    from gpis_grasp_planner.search.context import PlanningContext

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Adapted:
    """What the local adaption made of a batch of proposals.

    Attributes
    ----------
    attempts : Attempts
        Of all seeds whose hand came free.
    proposal : (B,) int array
        Which proposal each attempt belongs to.
    standoff : (B,) array [m]
        How far each hand stands back from where its palm would touch.
    """

    attempts: Attempts
    proposal: NDArray[np.int64]
    standoff: Array


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
    preshapes : PreshapeRange
        What seeds draw of the hand's pre-shape.
    fitting : HandFitting, optional
        Closes the hands where there are constraints; else the evaluator does.
    """

    def __init__(
        self,
        evaluator: GraspEvaluator,
        atlas: SurfaceAtlas,
        T_palm_face: Array,
        max_radius: float,
        settings: AdaptionSettings,
        preshapes: PreshapeRange,
        fitting: HandFitting | None = None,
    ):
        self.evaluator = evaluator
        self._close = evaluator.attempt if fitting is None else fitting.attempt
        self._approach_axis = None if fitting is None else fitting.approach_axis
        self.atlas = atlas
        self.settings = settings
        self.preshapes = preshapes
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
            context.preshapes,
            HandFitting(context),
        )

    def __call__(
        self, T_object_face: Array, rng: np.random.Generator, posture: Array | None = None
    ) -> Adapted:
        """Adapt proposals (k, 4, 4) of the palm's face, all seeds at once.

        Parameters
        ----------
        T_object_face : (k, 4, 4) array
        rng : numpy Generator
        posture : (k, S + 1) array, optional
            Pre-shape [rad or m] and standoff [m] of each proposal; its seeds vary about them.
            Without it every seed draws its own.
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
            if self._approach_axis is None:
                origin = center + self._face_height * chart.normal_outward
                poses.append(transform(np.broadcast_to(R, (n_seed, 3, 3)), origin))
            else:
                R_seed = self._tilted(R, self._approach_axis, rng)
                poses.append(transform(R_seed, center - self._face_height * R_seed[:, :, 2]))
            normals.append(np.broadcast_to(chart.normal_outward, (n_seed, 3)))
            owner.append(np.full(n_seed, k))
        if not poses:
            empty = np.zeros((0, 4, 4))
            attempts = self.evaluator.attempt(empty, np.zeros((0, len(self.preshapes))))
            return Adapted(attempts, np.zeros(0, dtype=np.int64), np.zeros(0))
        proposal = np.concatenate(owner)
        if posture is None:
            preshape, standoff = self._posture(len(proposal), rng)
        else:
            preshape, standoff = self._posture_near(posture[proposal], rng)
        T, free = self.evaluator.clear_palm(
            np.concatenate(poses), np.concatenate(normals), preshape, standoff
        )
        attempts = self._close(T[free], preshape[free])
        return Adapted(attempts, proposal[free], standoff[free])

    def destination(self, T_object_face: Array) -> Array:
        """Where proposals (n, 4, 4) are taken: on the nearest surface point, against its normal.

        The pose of the palm's face at lambda = 0 of the first seed; cheap (some us each).
        """
        index, points = self.atlas.nearest(T_object_face[:, :3, 3])
        normals = self.atlas.surface.normals_outward[index]
        return transform(palm_against(T_object_face[:, :3, :3], normals), points)

    def _tilted(self, R: Array, axis: Array, rng: np.random.Generator) -> Array:
        """Rotations (n_seed, 3, 3) of one proposal, some turned part of the way to an axis.

        A palm that lies flat on the side of a part has half of its fingers under the table.
        """
        n = self.settings.n_seed
        part = np.where(rng.random(n) < self.settings.tilt_share, rng.random(n), 0.0)
        part[0] = 0.0
        turn_axis = np.cross(R[:, 2], axis)
        sine = np.linalg.norm(turn_axis)
        angle = np.arctan2(sine, R[:, 2] @ axis)
        turn_axis = R[:, 0] if sine < 1e-9 else turn_axis / sine
        turn = Rotation.from_rotvec((part * angle)[:, None] * turn_axis).as_matrix()
        return np.asarray(turn @ R)

    def _posture(self, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
        s = self.settings
        preshape = self.preshapes.draw(n, rng)
        # Half of the hands start with the fingers opposed or evenly around: good guesses.
        favourite = rng.random(n) < 0.5
        preshape[favourite] = self.preshapes.guess(int(favourite.sum()), rng)
        standoff = np.where(
            rng.random(n) < s.standoff_share, rng.uniform(0.0, s.standoff_max_m, n), 0.0
        )
        standoff[_first_of(n, s.n_seed)] = 0.0
        return preshape, standoff

    def _posture_near(self, posture: Array, rng: np.random.Generator) -> tuple[Array, Array]:
        s = self.settings
        n = len(posture)
        vary = ~_first_of(n, s.n_seed)
        step = np.append(self.preshapes.step(s.vary_spread_deg), s.vary_standoff_m)
        posture = posture + vary[:, None] * step * rng.standard_normal((n, len(step)))
        free = vary & (rng.random(n) < s.free_share)
        posture[free] = np.column_stack(self._posture(n, rng))[free]
        return self.preshapes.clip(posture[:, :-1]), np.clip(posture[:, -1], 0.0, s.standoff_max_m)


def _first_of(n: int, n_seed: int) -> NDArray[np.bool_]:
    """Which of n rows are the first seed of their proposal."""
    return np.asarray(np.arange(n) % n_seed == 0)


def palm_against(R: Array, normal_outward: Array) -> Array:
    """Turn rotations (..., 3, 3) by the smallest angle so that their z is ``-normal_outward``."""
    z = R[..., :, 2]
    target = -np.asarray(normal_outward)
    axis = np.cross(z, target)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    cosine = np.sum(z * target, axis=-1, keepdims=True)
    # Opposite directions leave the axis open; the palm's x does.
    parallel = sine < 1e-12
    axis = np.where(parallel, R[..., :, 0], axis / np.where(parallel, 1.0, sine))
    turn = Rotation.from_rotvec((axis * np.arctan2(sine, cosine)).reshape(-1, 3)).as_matrix()
    return np.asarray(turn.reshape(R.shape) @ R)


def _disc(n: int, radius: float, rng: np.random.Generator) -> Array:
    """Points (n, 2) in a disc, the first one its centre."""
    r = radius * np.sqrt(rng.random(n))
    a = rng.uniform(0.0, 2.0 * np.pi, n)
    u = np.stack([r * np.cos(a), r * np.sin(a)], axis=1)
    u[0] = 0.0
    return u
