"""The evaluator of the search: everything from palm pose to epsilon in compiled code.

Exact where it decides (contacts, collisions and gaps come from distances between the link's
convex pieces and the mesh's triangles), quick where it only travels (distance field). Some 0.3
to 1 ms an attempt on one core.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.planning.evaluator import Attempts, Postures
from gpis_grasp_planner.quality.fast_epsilon import start_directions
from gpis_grasp_planner.scene.arrays import hand_arrays, object_arrays
from gpis_grasp_planner.scene.grasp_kernel import MAX_CONTACTS, attempt_many, clear_many
from gpis_grasp_planner.scene.motor_posture import postures_many
from gpis_grasp_planner.planning.scene_settings import SceneSettings

Array = NDArray[np.float64]

_DIRECTIONS = 256
_STARTS = 5
_STARTS_OF_GOOD = 20


class CompiledEvaluator:
    """Implements `planning.evaluator.GraspEvaluator`.

    Parameters
    ----------
    hand : HandDescription
    part : Part
    friction : Friction
    settings : SceneSettings
    field, tree : DistanceField, TriangleTree, optional
        Made from the mesh if not given.
    """

    def __init__(
        self,
        hand: HandDescription,
        part: Part,
        friction: Friction,
        settings: SceneSettings,
        field: DistanceField | None = None,
        tree: TriangleTree | None = None,
    ):
        self.hand = hand
        self._friction = friction
        self.settings = settings
        self.field = field or DistanceField.of(part.mesh, cells=settings.field_cells)
        self.tree = tree or TriangleTree.of(part.mesh)
        self._hand = hand_arrays(hand)
        self._object = object_arrays(part, friction, self.field, self.tree)
        self._directions = start_directions(_DIRECTIONS)
        self._n_attempts = 0

    @property
    def friction(self) -> Friction:
        """Friction of the pairs of hand link and object."""
        return self._friction

    @property
    def n_attempts(self) -> int:
        """Grasp attempts so far."""
        return self._n_attempts

    def attempt(self, T_object_palm: Array, spread: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) with spreads (B,) [rad]."""
        T = np.ascontiguousarray(T_object_palm, dtype=float)
        spread = np.ascontiguousarray(spread, dtype=float)
        n = len(T)
        result = Attempts(
            T_object_palm=T,
            spread=spread,
            status=np.zeros(n, dtype=np.int64),
            joints=np.zeros((n, self.hand.n_joints)),
            n_contacts=np.zeros(n, dtype=np.int64),
            positions=np.zeros((n, MAX_CONTACTS, 3)),
            normals_inward=np.zeros((n, MAX_CONTACTS, 3)),
            friction=np.zeros((n, MAX_CONTACTS)),
            links=np.zeros((n, MAX_CONTACTS), dtype=np.int64),
            epsilon=np.full(n, -1.0),
            volume=np.zeros(n),
        )
        attempt_many(
            self._hand,
            self._object,
            T,
            spread,
            self.settings.closing_gap_m,
            self.settings.contact_threshold_m,
            self.settings.cone_edges,
            self.settings.retreat_m,
            self._directions,
            _STARTS,
            _STARTS_OF_GOOD,
            result.status,
            result.n_contacts,
            result.epsilon,
            result.volume,
            result.joints,
            result.positions,
            result.normals_inward,
            result.friction,
            result.links,
        )
        self._n_attempts += n
        return result

    def postures(self, T_object_palm: Array, motors: Array) -> Postures:
        """Hands at poses (B, 4, 4) and motor angles (B, 1 + F) [rad]; see the protocol."""
        n, n_fingers = len(motors), len(self.hand.fingers)
        result = Postures(
            joints=np.zeros((n, self.hand.n_joints)),
            points=np.zeros((n, n_fingers, 2, 3)),
            inner_touches=np.zeros((n, n_fingers), dtype=np.bool_),
        )
        postures_many(
            self._hand,
            self._object,
            np.ascontiguousarray(T_object_palm, dtype=float),
            np.ascontiguousarray(motors, dtype=float),
            self.settings.closing_gap_m,
            result.joints,
            result.points,
            result.inner_touches,
        )
        return result

    def clear_palm(
        self, T_object_palm: Array, normals_outward: Array, spread: Array, standoff: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move open hands along the normals until they are free; see the protocol."""
        T = np.array(T_object_palm, dtype=float)
        free = np.zeros(len(T), dtype=np.bool_)
        clear_many(
            self._hand,
            self._object,
            T,
            np.ascontiguousarray(normals_outward, dtype=float),
            np.ascontiguousarray(spread, dtype=float),
            self.settings.lambda_step_m,
            self.settings.lambda_max_m,
            np.deg2rad(self.settings.theta_step_deg),
            self.settings.closing_gap_m,
            np.ascontiguousarray(standoff, dtype=float),
            free,
        )
        return T, free
