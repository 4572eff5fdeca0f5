"""How a hand's fingers close in PyBullet's scene: by bracketing on its distances."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.hand.description import SLIDING_LEVER_M, Finger, HandDescription
from gpis_grasp_planner.scene.bullet_world import BulletWorld

Array = NDArray[np.float64]

_REACH_M = 0.01
_BISECTED = 1e-6


class BulletClosing:
    """Closes fingers of a hand whose palm is placed in a world.

    Parameters
    ----------
    hand : HandDescription
    world : BulletWorld
        Of the same hand.
    gap : float [m]
        To leave between a link and the object.
    """

    def __init__(self, hand: HandDescription, world: BulletWorld, gap: float):
        self.hand, self.world, self.gap = hand, world, gap
        self._moving = [link for f in hand.fingers for link in f.links]
        self._radius, self._inner_radius = _radii(hand)

    def close(self, finger: Finger, joints: Array) -> bool:
        """Close one finger: coupled until a link touches, then the distal link alone."""
        hand, world, gap = self.hand, self.world, self.gap
        if len(finger.links) == 1:
            return self._close_one(finger, joints)
        ratio = hand.drive.distal_per_inner
        inner_upper = float(hand.joint_upper[finger.inner_joint])
        distal_upper = float(hand.joint_upper[finger.distal_joint])

        def gaps_coupled(angle: float) -> tuple[float, float]:
            world.set_joint(finger.inner_joint, angle)
            world.set_joint(finger.distal_joint, min(ratio * angle, distal_upper))
            return world.gap(finger.inner_link, _REACH_M), world.gap(finger.distal_link, _REACH_M)

        def gaps_distal(angle: float) -> tuple[float]:
            world.set_joint(finger.distal_joint, angle)
            return (world.gap(finger.distal_link, _REACH_M),)

        own = self._radius[finger.distal_link]
        speeds = (
            self._radius[finger.inner_link],
            self._inner_radius[finger.distal_link] + ratio * own,
        )
        inner, which = _advance(gaps_coupled, joints[finger.inner_joint], inner_upper, speeds, gap)
        distal = min(ratio * inner, distal_upper)
        touched = which is not None
        if which == 0:
            distal, _ = _advance(gaps_distal, distal, distal_upper, (own,), gap)
        joints[finger.inner_joint] = inner
        joints[finger.distal_joint] = distal
        world.set_joint(finger.inner_joint, inner)
        world.set_joint(finger.distal_joint, distal)
        return touched

    def _close_one(self, finger: Finger, joints: Array) -> bool:
        """Close a finger of one link."""
        world, joint = self.world, finger.inner_joint
        slides = bool(self.hand.joint_slides[joint])

        def gaps(position: float) -> tuple[float]:
            world.set_joint(joint, position)
            return (world.gap(finger.inner_link, _REACH_M),)

        joints[joint], which = _advance(
            gaps,
            joints[joint],
            float(self.hand.joint_upper[joint]) * (2.0 if self.hand.drive.coupled else 1.0),
            (1.0 if slides else self._radius[finger.inner_link],),
            self.gap,
        )
        world.set_joint(joint, joints[joint])
        return which is not None

    def centre(self, T_object_palm: Array, joints: Array) -> None:
        """Move a coupled hand's palm, in place, until both jaws touch alike (`scene.centring`)."""
        first, second = (finger.inner_joint for finger in self.hand.fingers)
        link = self.hand.fingers[0].inner_link
        common = 0.5 * (joints[first] + joints[second])
        axis = self.world.link_pose(link)[:3, :3] @ self.hand.joint_axis[link]
        T_object_palm[:3, 3] += (joints[first] - common) * axis
        joints[[first, second]] = common
        self.world.place_palm(T_object_palm)

    def fingers_meet(self, joints: Array, touched: Sequence[bool]) -> bool:
        """Whether a finger that touches the object meets another; free ones open to let it pass."""
        hand, world = self.hand, self.world
        for finger, touches in zip(hand.fingers, touched, strict=True):
            while not touches and joints[finger.inner_joint] > 0.0 and self._meets(finger, 1e-4):
                unit = SLIDING_LEVER_M if hand.joint_slides[finger.inner_joint] else 1.0
                inner = max(joints[finger.inner_joint] - 0.05 * unit, 0.0)
                joints[finger.inner_joint] = inner
                if len(finger.joints) > 1:
                    joints[finger.distal_joint] = hand.drive.distal_per_inner * inner
                    world.set_joint(finger.distal_joint, joints[finger.distal_joint])
                world.set_joint(finger.inner_joint, inner)
        return any(
            touches and self._meets(finger, 1e-5)
            for finger, touches in zip(hand.fingers, touched, strict=True)
        )

    def _meets(self, finger: Finger, limit: float) -> bool:
        own = {*finger.links, finger.knuckle_link}
        for link in finger.links:
            others = self._moving if link == finger.inner_link else range(self.hand.n_links)
            if any(self.world.links_near(link, o, limit) for o in others if o not in own):
                return True
        return False


def _advance(
    gaps: Callable[[float], tuple[float, ...]],
    start: float,
    end: float,
    speeds: tuple[float, ...],
    gap: float,
) -> tuple[float, int | None]:
    """Turn from `start` [rad] until a link is within two gaps of the object.

    `gaps(angle)` moves the links and gives their distances [m] (at most the reach, negative in
    penetration); no point of link i is faster than `speeds[i]` [m/rad]. Steps are safe by the
    speeds, lengthened by the slope of the last two distances, and halved back from an overlap.

    Returns
    -------
    angle : float
    touching : int or None
        Index of the touching link; None at the end of the travel.
    """
    free, angle = start, start
    before: tuple[float, ...] | None = None
    while True:
        now = gaps(angle)
        if min(now) <= 0.0:
            if angle - free < _BISECTED:
                gaps(free)
                return free, int(np.argmin(now))
            angle, before = 0.5 * (free + angle), None
            continue
        if min(now) < 2.0 * gap:
            return angle, int(np.argmin(now))
        if angle >= end:
            return end, None
        steps = []
        for i, d in enumerate(now):
            step = (d - gap) / speeds[i]
            if before is not None and d < before[i] < _REACH_M:
                step = max(step, 0.95 * (d - gap) * (angle - free) / (before[i] - d))
            steps.append(step)
        free, before = angle, now
        angle = min(angle + max(min(steps), _BISECTED), end)


def _radii(hand: HandDescription) -> tuple[Array, Array]:
    """Largest distance of a link's points from its own axis and from its finger's inner axis."""
    own = np.zeros(hand.n_links)
    inner = np.zeros(hand.n_links)
    for link, pieces in enumerate(hand.link_collision):
        points = np.concatenate([piece.vertices for piece in pieces])
        own[link] = np.linalg.norm(np.cross(hand.joint_axis[link], points), axis=1).max()
        offset = np.linalg.norm(hand.T_parent_joint[link][:3, 3])
        inner[link] = offset + np.linalg.norm(points, axis=1).max()
    return own, inner
