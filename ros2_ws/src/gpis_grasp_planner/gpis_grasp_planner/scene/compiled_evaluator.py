"""The evaluator of the search: everything from palm pose to epsilon in compiled code.

Exact where it decides (contacts, collisions and gaps come from distances between the link's
convex pieces and the mesh's triangles), quick where it only travels (distance field). Some 0.5
to 0.8 ms an attempt on one core.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus, Postures
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.quality.fast_epsilon import start_directions
from gpis_grasp_planner.scene.approach import approach_many
from gpis_grasp_planner.scene.arrays import hand_arrays, object_arrays
from gpis_grasp_planner.scene.grasp_kernel import (
    MAX_CONTACTS,
    attempt_many,
    attempt_many_from,
    clear_many,
)
from gpis_grasp_planner.scene.guided_potential import potential_many
from gpis_grasp_planner.scene.motor_posture import postures_many

Array = NDArray[np.float64]

_DIRECTIONS = 256
_STARTS = 5
_STARTS_OF_GOOD = 20
_PIECE = 16  # hands between two looks at the clock: some 16 ms


class CompiledEvaluator:
    """Implements `grasp.evaluator.PostureEvaluator`.

    Parameters
    ----------
    hand : HandDescription
    part : Part
    friction : Friction
    settings : SceneSettings
    field, tree : DistanceField, TriangleTree, optional
        Made from the mesh if not given.
    ended : callable, optional
        True once no further hand is to be closed: the rest of a batch is `NOT_TRIED` then. Asked
        every 16 hands; the first 16 are always closed.
    """

    def __init__(
        self,
        hand: HandDescription,
        part: Part,
        friction: Friction,
        settings: SceneSettings,
        field: DistanceField | None = None,
        tree: TriangleTree | None = None,
        ended: Callable[[], bool] = lambda: False,
    ):
        self.hand = hand
        self._friction = friction
        self.settings = settings
        self.field = field or DistanceField.of(part.working_mesh, cells=settings.field_cells)
        self.tree = tree or TriangleTree.of(part.mesh)
        self._hand = hand_arrays(hand)
        self._object = object_arrays(part, friction, self.field, self.tree)
        self._directions = start_directions(_DIRECTIONS)
        self._ended = ended
        self._n_attempts = 0
        self._n_states = 0

    @property
    def friction(self) -> Friction:
        """Friction of the pairs of hand link and object."""
        return self._friction

    @property
    def n_attempts(self) -> int:
        """Grasp attempts so far."""
        return self._n_attempts

    @property
    def n_states(self) -> int:
        """States whose guided potential was asked for so far."""
        return self._n_states

    def attempt(self, T_object_palm: Array, preshape: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) with pre-shapes (B, S)."""
        T = self._own(T_object_palm)
        preshape = np.ascontiguousarray(preshape, dtype=float)
        result = self._attempts(T, preshape)
        for piece in self._pieces(result):
            measures = self._measures(result, piece)
            attempt_many(self._hand, self._object, T[piece], preshape[piece], *measures)
        return result

    def postures(self, T_object_palm: Array, motors: Array) -> Postures:
        """Hands at poses (B, 4, 4) and motor angles (B, S + F); see the protocol."""
        n, n_fingers = len(motors), len(self.hand.fingers)
        n_inner = max(1, self.hand.drive.n_links - 1)
        result = Postures(
            joints=np.zeros((n, self.hand.n_joints)),
            points=np.zeros((n, n_fingers, 1 + n_inner, 3)),
            inner_touches=np.zeros((n, n_fingers, n_inner), dtype=np.bool_),
        )
        postures_many(
            self._hand,
            self._object,
            # Writable as well: read-only arrays are another type, and would compile all again.
            np.require(T_object_palm, float, ("C", "W")),
            np.require(motors, float, ("C", "W")),
            self.settings.closing_gap_m,
            result.joints,
            result.points,
            result.inner_touches,
        )
        return result

    def clear_palm(
        self, T_object_palm: Array, normals_outward: Array, preshape: Array, standoff: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move open hands along the normals until they are free; see the protocol."""
        T = np.array(T_object_palm, dtype=float)
        free = np.zeros(len(T), dtype=np.bool_)
        clear_many(
            self._hand,
            self._object,
            T,
            np.ascontiguousarray(normals_outward, dtype=float),
            np.ascontiguousarray(preshape, dtype=float),
            self.settings.lambda_step_m,
            self.settings.lambda_max_m,
            np.deg2rad(self.settings.theta_step_deg),
            self.settings.closing_gap_m,
            np.ascontiguousarray(standoff, dtype=float),
            free,
        )
        return T, free

    def attempt_from(self, T_object_palm: Array, joints: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) from postures (B, J) [rad]; see the protocol."""
        T = self._own(T_object_palm)
        start = np.ascontiguousarray(joints, dtype=float)
        result = self._attempts(T, self.hand.preshape.of(start), start)
        for piece in self._pieces(result):
            measures = self._measures(result, piece)
            attempt_many_from(self._hand, self._object, T[piece], start[piece], True, *measures)
        return result

    def approach(
        self, T_object_palm: Array, joints: Array, reach: float
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move free hands along the palm's axis until they touch; see the protocol."""
        T = np.array(T_object_palm, dtype=float)
        palm_touches = np.zeros(len(T), dtype=np.bool_)
        approach_many(
            self._hand,
            self._object,
            T,
            np.ascontiguousarray(joints, dtype=float),
            float(reach),
            self.settings.closing_gap_m,
            self.settings.contact_threshold_m,
            palm_touches,
        )
        return T, palm_touches

    def guided_potential(self, T_object_palm: Array, joints: Array) -> Array:
        """Guided potential quality energies (B,), inf where the hand collides."""
        energy = np.empty(len(T_object_palm))
        wanted = self.hand.desired_contacts
        potential_many(
            self._hand,
            self._object,
            np.ascontiguousarray(T_object_palm, dtype=float),
            np.ascontiguousarray(joints, dtype=float),
            wanted.links,
            wanted.points,
            wanted.normals,
            energy,
        )
        self._n_states += len(energy)
        return energy

    def _own(self, T_object_palm: Array) -> Array:
        """Poses for the kernel; a coupled hand's are moved there, and must not be the caller's."""
        if self._hand.coupled:
            return np.array(T_object_palm, dtype=float, order="C")
        return np.ascontiguousarray(T_object_palm, dtype=float)

    def _attempts(self, T: Array, preshape: Array, start: Array | None = None) -> Attempts:
        """Arrays for the kernel to fill."""
        n = len(T)
        return Attempts(
            T_object_palm=T,
            preshape=preshape,
            status=np.zeros(n, dtype=np.int64),
            joints=np.zeros((n, self.hand.n_joints)),
            n_contacts=np.zeros(n, dtype=np.int64),
            positions=np.zeros((n, MAX_CONTACTS, 3)),
            normals_inward=np.zeros((n, MAX_CONTACTS, 3)),
            friction=np.zeros((n, MAX_CONTACTS)),
            links=np.zeros((n, MAX_CONTACTS), dtype=np.int64),
            epsilon=np.full(n, -1.0),
            volume=np.zeros(n),
            start_joints=start,
        )

    def _pieces(self, result: Attempts) -> Iterator[slice]:
        """Rows to try, until all are tried or the time is over."""
        for start in range(0, len(result), _PIECE):
            if start and self._ended():
                result.status[start:] = AttemptStatus.NOT_TRIED
                return
            piece = slice(start, min(start + _PIECE, len(result)))
            yield piece
            self._n_attempts += piece.stop - piece.start

    def _measures(self, result: Attempts, rows: slice) -> tuple[Any, ...]:
        """The kernel's arguments after hand, object, poses and postures, of some rows."""
        return (
            self.settings.closing_gap_m,
            self.settings.contact_threshold_m,
            self.settings.cone_edges,
            self.settings.retreat_m,
            self._directions,
            _STARTS,
            _STARTS_OF_GOOD,
            result.status[rows],
            result.n_contacts[rows],
            result.epsilon[rows],
            result.volume[rows],
            result.joints[rows],
            result.positions[rows],
            result.normals_inward[rows],
            result.friction[rows],
            result.links[rows],
        )
