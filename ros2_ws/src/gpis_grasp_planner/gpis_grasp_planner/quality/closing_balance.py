"""Whether what the closing fingers press with can balance on the part (compiled, some 0.1 ms).

Epsilon asks what contacts could resist if they pressed as wanted; a hand presses as its motors do.
In a grasp that holds under a load w, contact forces lambda inside their friction cones are in
equilibrium with it and belong to the torques of the drives, ``G lambda = -w``, ``J^T lambda = tau``
(Prattichizzo and Trinkle, Grasping, Springer Handbook of Robotics, 2nd ed., sec. 38.2). Here tau is
not given but bounded, as worm gears have it: a finger that presses pushes with the fingertip's
force at least and resists its holding force at most; a joint that is held takes anything up to
that. What no such forces balance pushes the part along, while the hand closes or afterwards:

``imbalance = max_w min |G lambda + w| / load,  lambda in the cones of a share of the friction``

over no load and the six pushes of the strict protocol. It is 0 for a grasp that can be closed, and
pushed, without moving the part. How well it tells which grasps hold: `docs/verification.md`.

The problem is one of least squares with non-negative variables, solved by the active sets of Lawson
and Hanson (Solving Least Squares Problems, 1974, ch. 23) with Cholesky factors of the normal
equations; a column that depends on those taken is passed over. Each load starts from the active
set of the one before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms

Array = NDArray[np.float64]

# A joint this far beyond its coupling moves by a row of its own, and a joint this near to its end
# does not press [rad].
_FREED_RAD = 0.02
_AT_END_RAD = 0.01
_CONE_EDGES = 8
# How much more a bound of a drive counts than the equilibrium: bounds are kept to some percent of
# what remains unbalanced.
_BOUND_WEIGHT = 20.0


class ClosingBalance:
    """Imbalances of closed hands on one part.

    Parameters
    ----------
    hand : HandDescription
    center_of_mass : (3,) array [m]
        Of the part, in the object's frame.
    torque_scale : float [m]
        Torques are divided by it, as in epsilon.
    friction_share : float
        Share of the friction that is counted on. By less than 1 a balance is asked for that is not
        on the edge of sliding.
    press_n, hold_n : float [N]
        Force at the fingertip with which a finger presses, and up to which it is not driven back.
    load_n : float [N]
        Force of the pushes.
    """

    def __init__(
        self,
        hand: HandDescription,
        center_of_mass: Array,
        torque_scale: float,
        friction_share: float,
        press_n: float,
        hold_n: float,
        load_n: float,
    ):
        self._hand = hand
        self._center = np.array(center_of_mass, dtype=float)
        self._scale = float(torque_scale)
        self._share = float(friction_share)
        # A joint that a finger does not have is infinitely far from what it presses with.
        shape = (len(hand.fingers), hand.drive.n_links)
        self._links, self._arms = np.full(shape, -1), np.full(shape, np.inf)
        for number, finger in enumerate(hand.fingers):
            self._links[number, -len(finger.links) :] = finger.links
            self._arms[number, -len(finger.links) :] = tip_arms(hand, number)
        self._slides = hand.joint_slides[[finger.inner_joint for finger in hand.fingers]]
        self._press = np.full(self._arms.shape, press_n / load_n)
        self._hold = np.full(self._arms.shape, hold_n / load_n)
        if hand.drive.independent:
            self._hold = hand.of_fingers(hand.joint_effort) / self._arms / load_n
            self._press = np.minimum(self._press, self._hold)

    def imbalance(
        self,
        T_object_palm: Array,
        joints: Array,
        n_contacts: NDArray[np.int64],
        positions: Array,
        normals_inward: Array,
        friction: Array,
        links: NDArray[np.int64],
    ) -> Array:
        """What cannot be balanced of the worst push, over the push itself, (B,).

        Parameters
        ----------
        T_object_palm : (B, 4, 4) array
        joints : (B, J) array [rad]
            The closed hands.
        n_contacts : (B,) int array
        positions, normals_inward : (B, K, 3) arrays [m, unit]
            Contacts in the object's frame.
        friction, links : (B, K) arrays
        """
        hand = self._hand
        result = np.zeros(len(joints))
        poses = np.asarray(T_object_palm)[:, None] @ link_transforms(hand, joints)
        row, ended = self._rows(joints)
        axes = hand.joint_axis[self._links]
        moving = poses[:, self._links]
        imbalance_many(
            np.ascontiguousarray(np.einsum("bfjxy,fjy->bfjx", moving[..., :3, :3], axes)),
            np.ascontiguousarray(moving[..., :3, 3]),
            np.ascontiguousarray(T_object_palm, dtype=float),
            np.ascontiguousarray(row),
            np.ascontiguousarray(ended),
            self._links,
            self._slides,
            self._arms,
            self._press,
            self._hold,
            self._share,
            self._center,
            self._scale,
            np.ascontiguousarray(n_contacts, dtype=np.int64),
            np.ascontiguousarray(positions, dtype=float),
            np.ascontiguousarray(normals_inward, dtype=float),
            np.ascontiguousarray(friction, dtype=float),
            np.ascontiguousarray(links, dtype=np.int64),
            result,
        )
        return result

    def _rows(self, joints: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """By which row of its closing table a finger moved last, and whether that ended, (B, F)."""
        hand, drive = self._hand, self._hand.drive
        q, upper = hand.of_fingers(joints), hand.of_fingers(hand.joint_upper)
        at_end = q > upper - (_AT_END_RAD * hand.closing_unit)[:, None]
        row = np.tile(hand.first_joint, (len(q), 1))
        base = np.zeros_like(q)
        for h in range(1, drive.n_links):
            base += (q[..., h - 1] - base[..., h - 1])[..., None] * drive.closing_ratio[:, h - 1]
            goes_on = q[..., h] > base[..., h] + _FREED_RAD
            if drive.advances_at_stop:
                goes_on |= (row == h - 1) & at_end[..., h - 1]
            row[goes_on] = h
        return row, np.take_along_axis(at_end, row[..., None], axis=-1)[..., 0]


def tip_arms(hand: HandDescription, finger: int) -> tuple[float, ...]:
    """Distances [m] of a straight finger's tip from each of its joints.

    1 where the finger slides: the joint's effort is the force itself.
    """
    if hand.joint_slides[hand.fingers[finger].inner_joint]:
        return (1.0,)
    tip = hand.fingers[finger].tip_point
    arms = [float(np.linalg.norm(tip))]
    for link in hand.fingers[finger].links[:0:-1]:
        T = hand.T_parent_joint[link]
        tip = T[:3, :3] @ tip + T[:3, 3]
        arms.insert(0, float(np.linalg.norm(tip)))
    return tuple(arms)


@njit
def imbalance_many(  # type: ignore[no-untyped-def]
    axes, origins, T_object_palm, leads, ended, finger_links, slides, arms, press, hold, share,
    center, scale, n_contacts, positions, normals, friction, links, result,
):  # fmt: skip
    """Imbalances of B hands with F fingers of D links; axes and origins (B, F, D, 3).

    Of a finger `leads` (B, F) says which joint presses, if it has not `ended`; `press` and `hold`
    (F, D) are forces at the fingertip over the load.
    """
    n_fingers, n_links = finger_links.shape
    n_joints = n_fingers * n_links
    for row in range(len(result)):
        k = n_contacts[row]
        if k == 0:
            result[row] = 0.0
            continue
        edges = k * _CONE_EDGES
        n = edges + 2 * n_joints
        M = np.zeros((6 + 2 * n_joints, n))
        b = np.zeros(6 + 2 * n_joints)
        torque = np.zeros((n_joints, edges))
        deepest = np.zeros(n_fingers, dtype=np.int64)  # links up to the outermost that touches
        for c in range(k):
            finger, loaded = -1, 0
            for f in range(n_fingers):
                for j in range(n_links):
                    if links[row, c] == finger_links[f, j]:
                        finger, loaded = f, j + 1
            if finger >= 0:
                deepest[finger] = max(deepest[finger], loaded)
            normal, at = normals[row, c], positions[row, c]
            # a tangent by the axis that the normal has least of
            least = 0
            for axis in range(1, 3):
                if abs(normal[axis]) < abs(normal[least]):
                    least = axis
            reference = np.zeros(3)
            reference[least] = 1.0
            t_1 = np.cross(normal, reference)
            t_1 /= np.sqrt(np.sum(t_1 * t_1))
            t_2 = np.cross(normal, t_1)
            for e in range(_CONE_EDGES):
                angle = 2.0 * np.pi * e / _CONE_EDGES
                mu = share * friction[row, c]
                force = normal + mu * (np.cos(angle) * t_1 + np.sin(angle) * t_2)
                column = c * _CONE_EDGES + e
                M[:3, column] = force
                M[3:6, column] = np.cross(at - center, force) / scale
                if finger >= 0:
                    for j in range(loaded):
                        arm = np.cross(at - origins[row, finger, j], force)
                        if slides[finger]:
                            arm = force
                        value = np.sum(arm * axes[row, finger, j]) / arms[finger, j]
                        torque[n_links * finger + j, column] = value
        rows = 6
        for f in range(n_fingers):
            for j in range(deepest[f]):
                presses = j == leads[row, f] and not ended[row, f]
                for bound in range(2):
                    sign = 1.0 if bound == 0 else -1.0
                    limit = hold[f, j]
                    if bound == 0:
                        limit = press[f, j] if presses else -hold[f, j]
                    for column in range(edges):
                        M[rows, column] = _BOUND_WEIGHT * torque[n_links * f + j, column]
                    M[rows, edges + rows - 6] = -sign * _BOUND_WEIGHT
                    b[rows] = _BOUND_WEIGHT * limit
                    rows += 1
        result[row] = _worst_residual(M[:rows, : edges + rows - 6], b[:rows], T_object_palm[row])


@njit
def _worst_residual(M, b, T):  # type: ignore[no-untyped-def]
    """Largest residual over no push and unit pushes along the axes of a frame T (4, 4)."""
    m, n = M.shape
    x = np.zeros(n)
    passive = np.zeros(m, dtype=np.int64)
    worst = 0.0
    n_passive = 0
    for push in range(7):
        b[:6] = 0.0
        if push > 0:
            sign = 1.0 if push <= 3 else -1.0
            for axis in range(3):
                b[axis] = sign * T[axis, (push - 1) % 3]
        residual, n_passive = least_squares(M, b, x, passive, n_passive)
        worst = max(worst, residual)
    return worst


@njit
def least_squares(M, b, x, passive, n_passive):  # type: ignore[no-untyped-def]
    """``min |M x - b|`` over x >= 0, by the active sets of Lawson and Hanson.

    `x` (n,) is where to start and becomes the solution; its positive entries are those of the
    first `n_passive` columns that `passive` (m,) names. Returns the residual and the new number.
    """
    m, n = M.shape
    is_passive = np.zeros(n, dtype=np.bool_)
    for p in range(n_passive):
        is_passive[passive[p]] = True
    passed_over = np.zeros(n, dtype=np.bool_)
    G = np.zeros((m, m))
    L = np.zeros((m, m))
    y = np.zeros(m)
    residual = np.zeros(m)
    tolerance = 1e-9 * (1.0 + np.sqrt(np.sum(b * b)))
    entering = -1
    for _ in range(6 * m):
        while n_passive > 0:
            if not _solve(M, b, passive, n_passive, G, L, y):
                # only the column that came last can depend on the others
                n_passive -= 1
                column = passive[n_passive]
                x[column] = 0.0
                is_passive[column] = False
                passed_over[column] = True
                continue
            step, leaving = 1.0, -1
            for p in range(n_passive):
                if y[p] <= 0.0:
                    now = x[passive[p]]
                    ratio = now / (now - y[p]) if now > y[p] else 0.0
                    if ratio < step or leaving < 0:
                        step, leaving = ratio, p
            if leaving < 0:
                for p in range(n_passive):
                    x[passive[p]] = y[p]
                break
            for p in range(n_passive):
                x[passive[p]] += step * (y[p] - x[passive[p]])
            kept = 0
            for p in range(n_passive):
                column = passive[p]
                if p == leaving or x[column] <= 1e-14:
                    x[column] = 0.0
                    is_passive[column] = False
                    passed_over[column] = passed_over[column] or column == entering
                else:
                    passive[kept] = column
                    kept += 1
            n_passive = kept
        if entering >= 0 and is_passive[entering]:  # it was of use: all may come again
            for j in range(n):
                passed_over[j] = False
        for i in range(m):
            value = b[i]
            for p in range(n_passive):
                value -= M[i, passive[p]] * x[passive[p]]
            residual[i] = value
        best, entering = tolerance, -1
        for j in range(n):
            if is_passive[j] or passed_over[j]:
                continue
            slope = 0.0
            for i in range(m):
                slope += M[i, j] * residual[i]
            if slope > best:
                best, entering = slope, j
        if entering < 0 or n_passive == m:
            break
        passive[n_passive] = entering
        is_passive[entering] = True
        n_passive += 1
    return np.sqrt(np.sum(residual * residual)), n_passive


@njit
def _solve(M, b, passive, n, G, L, y):  # type: ignore[no-untyped-def]
    """Least squares on some columns by Cholesky; False where the last depends on the others."""
    m = M.shape[0]
    for p in range(n):
        for q in range(p + 1):
            value = 0.0
            for i in range(m):
                value += M[i, passive[p]] * M[i, passive[q]]
            G[p, q] = value
    for p in range(n):
        for q in range(p + 1):
            value = G[p, q]
            for k in range(q):
                value -= L[p, k] * L[q, k]
            if p == q:
                if value <= 1e-11 * G[p, p]:
                    return False
                L[p, p] = np.sqrt(value)
            else:
                L[p, q] = value / L[q, q]
    for p in range(n):
        value = 0.0
        for i in range(m):
            value += M[i, passive[p]] * b[i]
        for k in range(p):
            value -= L[p, k] * y[k]
        y[p] = value / L[p, p]
    for p in range(n - 1, -1, -1):
        value = y[p]
        for k in range(p + 1, n):
            value -= L[k, p] * y[k]
        y[p] = value / L[p, p]
    return True
