"""A referee of the arm that shares nothing with it: Newton on the published table, PyBullet."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pybullet
import trimesh
from arm_tables import DH
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.transforms import rotation_angle

Array = NDArray[np.float64]

POSITION_M, ANGLE_RAD = 1e-3, np.deg2rad(0.5)
TURN = 2.0 * np.pi


class Newton:
    """Numerical inverse kinematics from many random postures at once.

    Parameters
    ----------
    name : str
        Of a table of `arm_tables.DH`.
    arm : ArmDescription
        Its limits; base and flange are taken as identities.
    seed : int
    """

    def __init__(self, name: str, arm: Any, seed: int, starts: int = 128):
        self._dh = DH[name]
        self._lower, self._upper = arm.chain.joint_lower, arm.chain.joint_upper
        self._rng, self._n = np.random.default_rng(seed), starts

    def frames(self, q: Array) -> Array:
        """Frames (B, n + 1, 4, 4) of the table at joints (B, n)."""
        T = [np.tile(np.eye(4), (len(q), 1, 1))]
        for i, (d, a, alpha) in enumerate(self._dh):
            c, s, ca, sa = np.cos(q[:, i]), np.sin(q[:, i]), np.cos(alpha), np.sin(alpha)
            A = np.zeros((len(q), 4, 4))
            A[:, 0] = np.stack([c, -s * ca, s * sa, a * c], axis=1)
            A[:, 1] = np.stack([s, c * ca, -c * sa, a * s], axis=1)
            A[:, 2] = [0.0, sa, ca, d]
            A[:, 3, 3] = 1.0
            T.append(T[-1] @ A)
        return np.stack(T, axis=1)

    def solve(self, q: Array, pose: Array, iterations: int = 60) -> Array:
        """The postures (S, n) within the limits that reach a pose (4, 4), from starts (B, n)."""
        q = np.array(q)
        bounded = (self._upper < np.pi - 1e-9).any()
        for _ in range(iterations):
            T = self.frames(q)
            error = self._error(T[:, -1], pose)
            axis, at = T[:, :-1, :3, 2], T[:, :-1, :3, 3]
            J = np.concatenate([np.cross(axis, T[:, -1:, :3, 3] - at), axis], axis=2)
            size = np.linalg.norm(error, axis=1)
            damp = np.minimum(1e-2, 0.1 * size)[:, None, None] ** 2 * np.eye(6)
            JJ = np.einsum("bni,bnj->bij", J, J) + damp + 1e-14 * np.eye(6)
            step = np.einsum("bni,bi->bn", J, np.linalg.solve(JJ, error[..., None])[..., 0])
            largest = np.abs(step).max(axis=1, keepdims=True)
            q += step * np.minimum(1.0, 0.4 / np.maximum(largest, 1e-12))
            if bounded:
                q = np.clip(q, self._lower, self._upper)
        at = self.frames(q)[:, -1]
        good = np.linalg.norm(at[:, :3, 3] - pose[:3, 3], axis=1) < 1e-5
        good &= rotation_angle(at[:, :3, :3], pose[None, :3, :3]) < 1e-4
        return self._limited(q[good])

    def look(self, grasp: Any, T_world_object: Array) -> dict[str, Any]:
        """Whether an answered grasp is reached, and how far its joints are from its palm [mm]."""
        palm = T_world_object @ grasp.T_object_palm
        back = np.array(palm)
        back[:3, 3] -= grasp.approach_distance * palm[:3, 2]
        own = self.frames(np.array([grasp.arm.grasp, grasp.arm.pregrasp]))[:, -1]
        pairs = list(zip(own, (palm, back), strict=True))
        off = max(float(np.linalg.norm(T[:3, 3] - to[:3, 3])) for T, to in pairs)
        turned = max(float(rotation_angle(T[:3, :3], to[:3, :3])) for T, to in pairs)
        found = all(len(self.postures(pose)) > 0 for pose in (palm, back))
        return {
            "reached": bool(found and off < POSITION_M and turned < ANGLE_RAD),
            "off_mm": float(1e3 * off),
        }

    def postures(self, pose: Array) -> Array:
        """Distinct postures (S, n) that reach a pose."""
        starts = self._rng.uniform(
            np.maximum(self._lower, -np.pi),
            np.minimum(self._upper, np.pi),
            (self._n, len(self._dh)),
        )
        found = self.solve(starts, pose)
        kept: list[Array] = []
        for q in found:
            if all(np.abs((q - other + np.pi) % TURN - np.pi).max() > 0.05 for other in kept):
                kept.append(q)
        return np.array(kept).reshape(-1, len(self._dh))

    def refusal(
        self,
        palm: Array,
        settings: Any,
        up: Array,
        bullet: BulletArm,
        T_base_object: Array,
        hands: tuple[Array, Array],
    ) -> str:
        """Why a palm (4, 4) in the base's frame is refused as well; "free" where it is not."""
        retreat = settings.scene.retreat_m
        postures = self.postures(palm)
        if not len(postures):
            return "no posture at the grasp"
        why = "no straight approach"
        for q in postures:
            back = self._line(q, palm, -retreat * palm[:3, 2])
            if back is None:
                continue
            lift = self._line(q, palm, settings.arm.lift_m * up)
            if lift is None:
                why = "no straight lift"
                continue
            if not self._turnable(np.concatenate([back, lift])):
                why = "limits on the way"
                continue
            why = bullet.touches(back, T_base_object, hands[0]) or bullet.touches(
                lift, None, hands[1]
            )
            if not why:
                return "free"
        return why

    def _line(self, q: Array, pose: Array, move: Array) -> Array | None:
        """Joints along a line by steps of 2 mm; None where they leave it or jump."""
        n = max(int(np.ceil(np.linalg.norm(move) / 0.002)), 1)
        way = [q]
        for k in range(1, n + 1):
            target = np.array(pose)
            target[:3, 3] += k / n * move
            found = self.solve(way[-1][None], target, 8)
            if not len(found):
                return None
            step = (found[0] - way[-1] + np.pi) % TURN - np.pi
            if np.abs(step).max() > 0.2:
                return None
            way.append(way[-1] + step)
        return np.array(way)

    def _turnable(self, way: Array) -> bool:
        low = np.ceil((self._lower - way.min(axis=0) - 1e-6) / TURN)
        high = np.floor((self._upper - way.max(axis=0) + 1e-6) / TURN)
        return bool((low <= high).all())

    def _limited(self, q: Array) -> Array:
        low = np.ceil((self._lower - q - 1e-6) / TURN)
        high = np.floor((self._upper - q + 1e-6) / TURN)
        return np.asarray(q[(low <= high).all(axis=1)])

    def _error(self, T: Array, pose: Array) -> Array:
        R = pose[:3, :3] @ T[:, :3, :3].transpose(0, 2, 1)
        w = np.stack(
            [R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1
        )
        sine = 0.5 * np.linalg.norm(w, axis=1)
        angle = np.arctan2(sine, 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0))
        scale = np.where(sine > 1e-9, angle / np.maximum(2.0 * sine, 1e-12), 0.5)
        return np.concatenate([pose[:3, 3] - T[:, :3, 3], scale[:, None] * w], axis=1)


class BulletArm:
    """The arm's URDF, the hand, a table at height 0 and a part in PyBullet, for distances alone."""

    def __init__(self, arm: Any, hand: Any, part: Any, margin_m: float):
        self._margin = margin_m
        self._may_touch = arm.may_touch
        self._client = client = pybullet.connect(pybullet.DIRECT)
        path = arm_urdf(arm)
        flags = pybullet.URDF_USE_SELF_COLLISION
        self._arm = pybullet.loadURDF(
            str(path), useFixedBase=True, flags=flags, physicsClientId=client
        )
        self._hand = pybullet.loadURDF(
            str(hand.urdf_path), useFixedBase=True, physicsClientId=client
        )
        self._hand_joints = self._movable(self._hand, hand.joint_names)
        self._arm_joints = self._movable(self._arm, arm.chain.joint_names)
        half = [3.0, 3.0, 0.5]
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_BOX, halfExtents=half, physicsClientId=client
        )
        self._table = pybullet.createMultiBody(
            0, shape, basePosition=[0, 0, -0.5], physicsClientId=client
        )
        mesh = trimesh.Trimesh(part.working_mesh.vertices, part.working_mesh.faces)
        shape = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=mesh.vertices.tolist(),
            indices=mesh.faces.ravel().tolist(),
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=client,
        )
        self._part = pybullet.createMultiBody(0, shape, physicsClientId=client)

    def close(self) -> None:
        """Leave PyBullet."""
        pybullet.disconnect(self._client)

    def meets(self, grasp: Any, T_base_object: Array) -> str:
        """What an answered grasp's way comes near to; empty where nothing.

        With 1 mm less than the margin: PyBullet's distances are not exact to that.
        """
        margin, self._margin = self._margin, self._margin - 1e-3
        try:
            return self.touches(
                grasp.arm.approach, T_base_object, grasp.pregrasp_joints
            ) or self.touches(grasp.arm.lift, None, grasp.joints)
        finally:
            self._margin = margin

    def touches(self, way: Array, T_part: Array | None, posture: Array) -> str:
        """What the arm comes nearer to than its margin on a way (K, n); empty where nothing."""
        client, n = self._client, way.shape[1]
        place(self._part, np.eye(4) if T_part is None else T_part, client)
        for joint, angle in zip(self._hand_joints, posture, strict=True):
            pybullet.resetJointState(self._hand, joint, angle, physicsClientId=client)
        for q in way:
            for joint, angle in zip(self._arm_joints, q, strict=True):
                pybullet.resetJointState(self._arm, joint, angle, physicsClientId=client)
            state = pybullet.getLinkState(
                self._arm, n, computeForwardKinematics=True, physicsClientId=client
            )
            base = flange_base(self._hand, state[4], state[5], client)
            pybullet.resetBasePositionAndOrientation(self._hand, *base, physicsClientId=client)
            if self._near(self._table, 2, n):
                return "table"
            if T_part is not None and self._near(self._part, 1, n):
                return "part"
            if self._near(self._hand, 0, n - 2):
                return "hand"
            for i, j in itertools.combinations(range(n + 1), 2):
                if j - i > 1 and (i, j) not in self._may_touch and self._near(self._arm, i, i, j):
                    return "itself"
        return ""

    def _near(self, other: int, first: int, last: int, link: int | None = None) -> bool:
        """Whether links first to last (0 the base) come near a body, or near one link of it."""
        of_other = {} if link is None else {"linkIndexB": link - 1}
        return any(
            pybullet.getClosestPoints(
                self._arm, other, self._margin, linkIndexA=i - 1,
                physicsClientId=self._client, **of_other,
            )
            for i in range(first, last + 1)
        )  # fmt: skip

    def _movable(self, body: int, names: tuple[str, ...]) -> list[int]:
        found = {
            pybullet.getJointInfo(body, i, physicsClientId=self._client)[1].decode(): i
            for i in range(pybullet.getNumJoints(body, physicsClientId=self._client))
        }
        return [found[name] for name in names]


def arm_urdf(arm: Any) -> Any:
    """The URDF of a shipped arm."""
    from pathlib import Path

    import gpis_grasp_planner.arm.description as module

    return Path(module.__file__).parent / f"models/{arm.name}/{arm.name}.urdf"


def place(body: int, T: Array, client: int) -> None:
    """Put a body without inertial frame at a pose (4, 4)."""
    quat = trimesh.transformations.quaternion_from_matrix(T)
    pybullet.resetBasePositionAndOrientation(
        body, T[:3, 3].tolist(), [*quat[1:], quat[0]], physicsClientId=client
    )


def flange_base(body: int, position: Any, orientation: Any, client: int) -> tuple[Any, Any]:
    """Where PyBullet wants a body's base (its centre of mass) for its root link to be at a pose."""
    dynamics = pybullet.getDynamicsInfo(body, -1, physicsClientId=client)
    return pybullet.multiplyTransforms(position, orientation, dynamics[3], dynamics[4])
