"""Turns that bring a part onto itself, as its YAML file declares them.

Of a part that looks the same after a turn an estimator tells any of the equal poses, now this one,
now that. All of them stand for the same place of the same body; `SymmetryGroup.chosen` picks one of
them by a rule that depends on the class alone, so that a plan for one is a plan for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import (
    cross_matrix,
    rotation_about,
    rotation_angle,
    transform,
)

Array = NDArray[np.float64]

MOST_TURNS = 360
_SAME_RAD = 1e-3
# An axis that stands upright within so much: turns about it do not move what is above.
_UPRIGHT = np.sin(np.radians(3.0))
# Unit vectors in a part's frame that count as the same.
_EQUAL = 0.02
# No axis of a part is likely to be along it.
_REFERENCE = np.array([0.36, 0.48, 0.80])
_TOLERANCE_SHARE = 0.02
_N_CHECKED = 2000


@dataclass(frozen=True, eq=False)
class Turn:
    """A declared turn about a point: by every multiple of an angle, or by any.

    Attributes
    ----------
    rotvec : (3,) array [rad]
        The smallest turn; with `any_angle` only its direction counts.
    point : (3,) array [m]
        On the axis, in the mesh's frame.
    any_angle : bool
        A body of revolution.
    """

    rotvec: Array
    point: Array
    any_angle: bool = False

    def matrix(self, angle: float | None = None) -> Array:
        """The turn (4, 4), or one about its axis by another angle [rad]."""
        length = float(np.linalg.norm(self.rotvec))
        R = rotation_about(self.rotvec / length, length if angle is None else angle)
        return transform(R, self.point - R @ self.point)


class SymmetryGroup:
    """All turns that follow from declared ones, each after any other.

    Parameters
    ----------
    turns : sequence of Turn
        At most one by any angle.

    Attributes
    ----------
    matrices : (n, 4, 4) array
        The turns by fixed angles, the identity first.
    axis : Turn or None
        The one by any angle, which combines with each of them.

    Raises
    ------
    ValueError
        For two turns by any angle, turns that do not map the axis onto itself, and more than 360
        turns: such turns are not those of a body.
    """

    def __init__(self, turns: Sequence[Turn]) -> None:
        free = [turn for turn in turns if turn.any_angle]
        if len(free) > 1:
            raise ValueError("only one axis can have order 'any'")
        self.axis = free[0] if free else None
        self.matrices = _closure([turn.matrix() for turn in turns if not turn.any_angle])
        if self.axis is not None:
            self._check_axis()

    def _check_axis(self) -> None:
        assert self.axis is not None
        direction = self.axis.rotvec / np.linalg.norm(self.axis.rotvec)
        for T in self.matrices:
            across = np.linalg.norm(np.cross(T[:3, :3] @ direction, direction))
            off = T[:3, :3] @ self.axis.point + T[:3, 3] - self.axis.point
            off = off - (off @ direction) * direction
            if across > _SAME_RAD or np.linalg.norm(off) > 1e-4:
                raise ValueError("another turn does not map the axis with order 'any' onto itself")

    def chosen(self, T_world_object: Array) -> Array:
        """The pose (4, 4) that stands for all that are equal to `T_world_object`.

        The one whose upward direction, seen from the part, is nearest a fixed one; of those with
        the same upward direction, the one turned least against the world. So a part that lies with
        the same side up has the same place, however it is turned about the vertical.
        """
        poses = T_world_object @ self.matrices
        if self.axis is not None:
            poses = np.stack([self._best_about_axis(T) for T in poses])
        up = poses[:, 2, :3]  # the world's z seen from the part
        highest = up[int(np.argmax(up @ _REFERENCE))]
        near = np.flatnonzero(np.linalg.norm(up - highest, axis=1) < _EQUAL)
        turned = rotation_angle(np.eye(3), poses[near, :3, :3])
        return np.asarray(poses[near[int(np.argmin(turned))]])

    def _best_about_axis(self, T: Array) -> Array:
        """The pose turned about the free axis so that the same rule holds."""
        assert self.axis is not None
        axis = self.axis.rotvec / np.linalg.norm(self.axis.rotvec)
        across = T[2, :3] - (T[2, :3] @ axis) * axis
        if np.linalg.norm(across) > _UPRIGHT:
            reference = _REFERENCE - (_REFERENCE @ axis) * axis
            # up' = R(angle)^T up: the angle from the reference to up, about the axis.
            angle = np.arctan2(np.cross(reference, across) @ axis, reference @ across)
        else:
            # trace(R R(angle)) = trace(R) + sin(angle) trace(R K) + (1 - cos(angle)) trace(R K K)
            R, K = T[:3, :3], cross_matrix(axis)
            angle = np.arctan2(np.trace(R @ K), -np.trace(R @ K @ K))
        return np.asarray(T @ self.axis.matrix(float(angle)))

    def deviation(self, mesh: TriangleMesh, seed: int = 0) -> tuple[float, float]:
        """How far the turned part stands out of itself [m], and how far it may.

        Looks at some 2,000 vertices and middles of triangles; a free axis is tried at angles that
        no regular polygon shares. The limit is 2 % of the farthest point's distance from the
        middle: tessellated cylinders pass, small features that break a symmetry do too.
        """
        from gpis_grasp_planner.geometry.triangle_tree import TriangleTree  # loads compiled code

        points = np.concatenate([mesh.vertices, mesh.triangles.mean(axis=1)])
        if len(points) > _N_CHECKED:
            points = np.random.default_rng(seed).permutation(points)[:_N_CHECKED]
        turns = list(self.matrices[1:])
        if self.axis is not None:
            turns += [self.axis.matrix(angle) for angle in (0.5, 1.3, 2.4)]
        tree, worst = TriangleTree.of(mesh), 0.0
        for T in turns:
            _, distance, _ = tree.nearest(points @ T[:3, :3].T + T[:3, 3])
            worst = max(worst, float(distance.max()))
        middle = mesh.bounds.mean(axis=0)
        radius = float(np.linalg.norm(mesh.vertices - middle, axis=1).max())
        return worst, _TOLERANCE_SHARE * radius


def _closure(generators: Sequence[Array]) -> Array:
    """All products of turns (n, 4, 4), the identity first."""
    found = [np.eye(4)]
    for T in found:  # grows meanwhile
        for generator in generators:
            new = generator @ T
            if all(not _same(new, known) for known in found):
                if len(found) >= MOST_TURNS:
                    raise ValueError(f"together they are more than {MOST_TURNS} turns")
                found.append(new)
    return np.stack(found)


def _same(one: Array, other: Array) -> bool:
    near = np.linalg.norm(one[:3, 3] - other[:3, 3]) < 1e-5
    return bool(near and rotation_angle(one[:3, :3], other[:3, :3]) < _SAME_RAD)
