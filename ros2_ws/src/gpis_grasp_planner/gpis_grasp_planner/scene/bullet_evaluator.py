"""The evaluator in PyBullet: the same narrow interface as the compiled one, some 100 times slower.

It shares the drive's law and the quality metric with the compiled evaluator, but neither its
collision detection nor its closing, and serves as its referee: :meth:`BulletEvaluator.attempt`
closes the hand by bracketing on PyBullet's distances, :meth:`BulletEvaluator.confirm` looks at
finished grasps.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.open_hand import open_postures
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.grasp.tally import Tally
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.quality.wrench_space import grasp_quality
from gpis_grasp_planner.scene.bullet_closing import BulletClosing
from gpis_grasp_planner.scene.bullet_world import BulletWorld
from gpis_grasp_planner.scene.confirmation import Confirmation

Array = NDArray[np.float64]

MAX_CONTACTS = 24
_PER_LINK = 5
_APART_M = 0.0015
_RETREAT_STEPS = 6
_RETREAT_DEPTH_M = 5e-4
_CLAIM_TOLERANCE_M = 5e-5


class BulletEvaluator:
    """Implements `grasp.evaluator.GraspEvaluator` in PyBullet; a context manager.

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
        self.part = part
        self.friction = friction
        self.settings = settings
        self.world = BulletWorld.of_part(hand, part, field, tree)
        self._closing = BulletClosing(hand, self.world, settings.closing_gap_m)
        self._n_attempts = 0
        self.tally = Tally()

    def __enter__(self) -> Self:
        self.world.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.world.__exit__(kind, value, trace)

    @property
    def n_attempts(self) -> int:
        """Grasp attempts so far."""
        return self._n_attempts

    def attempt(self, T_object_palm: Array, preshape: Array) -> Attempts:
        """Close the hand at poses (B, 4, 4) with pre-shapes (B, S); 50 to 500 ms each."""
        n = len(preshape)
        result = Attempts(
            T_object_palm=np.array(T_object_palm, dtype=float),
            preshape=np.array(preshape, dtype=float),
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
        for row in range(n):
            status, joints, contacts, quality = self._attempt(
                result.T_object_palm[row], preshape[row]
            )
            k = len(contacts)
            result.status[row] = status
            result.joints[row] = joints
            result.n_contacts[row] = k
            result.positions[row, :k] = contacts.positions
            result.normals_inward[row, :k] = contacts.normals_inward
            result.friction[row, :k] = contacts.friction
            result.links[row, :k] = contacts.links
            result.epsilon[row] = quality.epsilon
            result.volume[row] = quality.volume
        self._n_attempts += n
        self.tally.propose(result)
        return result

    def clear_palm(
        self, T_object_palm: Array, normals_outward: Array, preshape: Array, standoff: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Move open hands along the normals until they are free; see the protocol."""
        T = np.array(T_object_palm, dtype=float)
        free = np.zeros(len(T), dtype=np.bool_)
        for row in range(len(T)):
            self.world.set_joints(self._open(preshape[row]))
            free[row] = self._clear(T[row], normals_outward[row], float(standoff[row]))
        self.tally.reject(np.asarray(T_object_palm), free)
        return T, free

    def confirm(self, grasps: Sequence[Grasp]) -> list[Confirmation]:
        """Look at finished grasps in PyBullet's scene; some 5 to 50 ms each."""
        return [self._confirm(grasp) for grasp in grasps]

    def _confirm(self, grasp: Grasp) -> Confirmation:
        self.world.place_palm(grasp.T_object_palm)
        self.world.set_joints(grasp.joints)
        threshold = self.settings.contact_threshold_m
        gaps = np.array([self.world.gap(link, 0.005) for link in range(self.hand.n_links)])
        deepest = int(np.argmin(gaps))
        claimed = np.unique(grasp.contacts.links)
        farthest = float(gaps[claimed].max()) if len(claimed) else 0.0
        depth = max(0.0, -float(gaps[deepest]))
        return Confirmation(
            penetration_m=depth,
            deepest_link=self.hand.link_names[deepest] if depth > 0.0 else None,
            farthest_contact_m=farthest,
            contacts_confirmed=farthest <= threshold + _CLAIM_TOLERANCE_M,
        )

    def _open(self, preshape: float) -> Array:
        return open_postures(self.hand, np.array([preshape]))[0]

    def _attempt(self, T: Array, preshape: float) -> tuple[AttemptStatus, Array, Contacts, Quality]:
        world, settings = self.world, self.settings
        joints = self._open(preshape)
        nothing = (Contacts.none(), Quality(-1.0, 0.0))
        world.place_palm(T)
        world.set_joints(joints)
        if world.hand_gap(settings.contact_threshold_m) <= 0.0:
            return (AttemptStatus.PALM_COLLISION, joints, *nothing)
        closing = self._closing
        touched = [closing.close(finger, joints) for finger in self.hand.fingers]
        if self.hand.drive.coupled:
            if not all(touched):
                return (AttemptStatus.TOO_FEW_CONTACTS, joints, *nothing)
            closing.centre(T, joints)
            for posture in (self._open(preshape), joints):
                world.set_joints(posture)
                if world.hand_gap(settings.contact_threshold_m) <= 0.0:
                    return (AttemptStatus.PALM_COLLISION, joints, *nothing)
        if closing.fingers_meet(joints, touched):
            return (AttemptStatus.SELF_COLLISION, joints, *nothing)
        contacts = self._contacts() if any(touched) else Contacts.none()
        if len(contacts) < 2:
            return AttemptStatus.TOO_FEW_CONTACTS, joints, contacts, nothing[1]
        quality = grasp_quality(
            contacts, self.part.center_of_mass, self.part.max_radius, settings.cone_edges
        )
        if quality.epsilon > 0.0 and not self._way_back(T, preshape):
            return AttemptStatus.NO_WAY_BACK, joints, contacts, nothing[1]
        return AttemptStatus.GRASPED, joints, contacts, quality

    def _contacts(self) -> Contacts:
        positions, normals, links = [], [], []
        for link in range(self.hand.n_links):
            found = self.world.contacts(link, self.settings.contact_threshold_m)
            for index in _well_apart(found.on_object, found.normals_inward):
                positions.append(found.on_object[index])
                normals.append(found.normals_inward[index])
                links.append(link)
        k = min(len(links), MAX_CONTACTS)
        if k == 0:
            return Contacts.none()
        groups = [self.hand.link_friction_group[link] for link in links[:k]]
        friction = [self.friction.palm if g == "palm" else self.friction.finger for g in groups]
        return Contacts(
            np.array(positions[:k]),
            np.array(normals[:k]),
            np.array(friction),
            np.array(links[:k], dtype=np.intp),
        )

    def _way_back(self, T: Array, preshape: float) -> bool:
        self.world.set_joints(self._open(preshape))
        for step in range(1, _RETREAT_STEPS + 1):
            back = T.copy()
            back[:3, 3] -= self.settings.retreat_m * step / _RETREAT_STEPS * T[:3, 2]
            self.world.place_palm(back)
            if self.world.hand_gap(0.0) < -_RETREAT_DEPTH_M:
                return False
        return True

    def _clear(self, T: Array, normal: Array, standoff: float) -> bool:
        """The ladder of Alg. 2 in place in T, refined to contact as in `scene.palm`."""
        settings, world = self.settings, self.world
        start = T[:3, 3].copy()
        level = turned = 0.0
        while True:
            T[:3, 3] = start + level * normal
            world.place_palm(T)
            gap = world.hand_gap(settings.lambda_step_m)
            if gap > 0.0:
                break
            if level < settings.lambda_max_m:
                level += settings.lambda_step_m
                continue
            turned += settings.theta_step_deg
            if turned >= 360.0:
                return False
            c, s = (
                np.cos(np.radians(settings.theta_step_deg)),
                np.sin(np.radians(settings.theta_step_deg)),
            )
            T[:3, :2] = T[:3, :2] @ np.array([[c, -s], [s, c]])
        for _ in range(12 if level > 0.0 else 0):
            if gap < 2.0 * settings.closing_gap_m:
                break
            advance = gap - settings.closing_gap_m
            T[:3, 3] -= advance * normal
            world.place_palm(T)
            gap = world.hand_gap(settings.lambda_step_m)
            if gap <= 0.0:
                T[:3, 3] += (advance + settings.closing_gap_m) * normal
                break
        T[:3, 3] += standoff * normal
        world.place_palm(T)
        return world.hand_gap(settings.lambda_step_m) > 0.0


def _well_apart(points: Array, normals: Array) -> list[int]:
    """Up to five of the points (nearest first): the first, then always the farthest apart."""
    if len(points) == 0:
        return []
    chosen = [0]
    apart = np.full(len(points), np.inf)
    while len(chosen) < _PER_LINK:
        last = chosen[-1]
        distance = np.linalg.norm(points - points[last], axis=1)
        turned = normals @ normals[last] < np.cos(np.radians(20.0))
        apart = np.minimum(apart, np.where(turned, np.maximum(distance, 2 * _APART_M), distance))
        best = int(np.argmax(apart))
        if apart[best] < _APART_M:
            break
        chosen.append(best)
    return chosen
