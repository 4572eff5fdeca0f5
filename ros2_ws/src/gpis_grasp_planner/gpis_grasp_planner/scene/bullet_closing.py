"""How a hand's fingers close in PyBullet's scene: by bracketing on its distances."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.drive import joints_from_motors, motors_from_joints
from gpis_grasp_planner.hand.finger import Finger
from gpis_grasp_planner.scene.bullet_world import BulletWorld

Array = NDArray[np.float64]
Gaps = tuple[float, ...]

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
        self._speed = _speeds(hand)

    def close(self, finger: Finger, joints: Array) -> bool:
        """Close one finger by the rows of its closing table; returns whether it touches."""
        hand, drive = self.hand, self.hand.drive
        members, table = list(finger.joints), finger.closing_ratio
        n = len(members)
        upper = hand.joint_upper[members] * (2.0 if drive.coupled else 1.0)
        q = np.array(joints[members])
        row, touched = 0, False
        base = np.zeros(n)
        while drive.advances_at_stop and row + 1 < n and q[row] >= upper[row] - _BISECTED:
            row += 1
            base = q - table[row] * q[row]
        while row < n:
            free = range(row, n)

            def move(at: float, row: int = row, base: Array = base) -> None:
                moved = np.minimum(base + table[row] * at, upper)
                q[row:] = moved[row:]
                for k in range(row, n):
                    self.world.set_joint(members[k], q[k])

            def gaps(at: float, free: range = free, move: Callable[[float], None] = move) -> Gaps:
                move(at)
                return tuple(self.world.gap(finger.links[k], _REACH_M) for k in free)

            speeds = tuple(float(self._speed[row, finger.links[k]]) for k in free)
            at, which = _advance(gaps, float(q[row]), float(upper[row]), speeds, self.gap)
            move(at)
            touched = touched or which is not None
            if which is not None:
                row += which + 1
            elif drive.advances_at_stop and row + 1 < n:
                row += 1
            else:
                break
            if row < n:
                base = q - table[row] * q[row]
        joints[members] = q
        return touched

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
        hand = self.hand
        for index, finger in enumerate(hand.fingers):
            members = list(finger.joints)
            while not touched[index] and joints[members].max() > 0.0 and self._meets(finger, 1e-4):
                self._open(index, joints)
        return any(
            touches and self._meets(finger, 1e-5)
            for finger, touches in zip(hand.fingers, touched, strict=True)
        )

    def _open(self, index: int, joints: Array) -> None:
        """Open a finger that touches nothing by a step along the way it came."""
        hand, finger = self.hand, self.hand.fingers[index]
        _, motors = motors_from_joints(hand, joints)
        motors[0, index] = max(motors[0, index] - 0.05 * hand.closing_unit[index], 0.0)
        opened = joints_from_motors(hand, hand.preshape.of(joints[None]), motors)[0]
        for joint in finger.joints:
            joints[joint] = opened[joint]
            self.world.set_joint(joint, joints[joint])

    def _meets(self, finger: Finger, limit: float) -> bool:
        own = {*finger.links, finger.knuckle_link}
        for link in finger.links:
            others = self._moving if link == finger.inner_link else range(self.hand.n_links)
            if any(self.world.links_near(link, o, limit) for o in others if o not in own):
                return True
        return False


def _advance(
    gaps: Callable[[float], Gaps],
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


def _speeds(hand: HandDescription) -> Array:
    """Largest speed (D, L) of a finger link's points per motion of the first joint of a row."""
    speeds = np.zeros((hand.drive.n_links, hand.n_links))
    for finger in hand.fingers:
        for number, link in enumerate(finger.links):
            points = np.concatenate([piece.vertices for piece in hand.link_collision[link]])
            axis = hand.joint_axis[link]
            reach = [
                1.0
                if hand.joint_slides[finger.joints[number]]
                else float(np.linalg.norm(np.cross(axis, points), axis=1).max())
            ]
            lever = float(np.linalg.norm(points, axis=1).max())
            for inwards in finger.links[number:0:-1]:
                lever += float(np.linalg.norm(hand.T_parent_joint[inwards][:3, 3]))
                reach.insert(0, lever)
            for row in range(number + 1):
                ratio = finger.closing_ratio[row, row : number + 1]
                speeds[row, link] = ratio @ np.array(reach[row:])
    return speeds
