"""Pairs and triples of surface points that can hold a part between them.

By two point contacts with friction a part is held if the line between them lies within both
friction cones (Nguyen, 1988). Three forces are in balance if they meet in one point; here that is
the centroid of the contacts, whose connecting lines add up to nothing, so that a triple counts
where each lies within its cone.

Normals and curvature are those of the implicit surface. A set weighs less the nearer it is to the
edges of its cones, the farther its centre is from the centre of mass (whose weight it then has to
hold by torque), and the more the normal changes within a fingertip: edges.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.surface.chart import SMALLEST_GRADIENT, tangent_basis

if TYPE_CHECKING:
    from gpis_grasp_planner.surface.atlas import SurfaceAtlas

Array = NDArray[np.float64]
Index = NDArray[np.intp]

_POINTS = 900
_TRIPLES = 40_000
_KEPT = 4000
_FINGERTIP_M = 0.003
_CENTER_RATIO = 0.2  # of the largest radius: where a set's weight has fallen to 1/e
_NARROWEST_M = 5e-4


@dataclass(frozen=True, eq=False)
class ContactSets:
    """Sets of k contacts on a part, in its frame.

    Attributes
    ----------
    points, normals_outward : (n, k, 3) arrays
    weight : (n,) array
        Chance to be drawn, adds up to one.
    """

    points: Array
    normals_outward: Array
    weight: Array

    def __len__(self) -> int:
        return len(self.weight)

    def none(self) -> ContactSets:
        """No set at all."""
        return ContactSets(self.points[:0], self.normals_outward[:0], self.weight[:0])

    def draw(self, n: int, rng: np.random.Generator) -> Index:
        """Rows (n,) by their weight."""
        return rng.choice(len(self.weight), n, p=self.weight)


class ContactSampler:
    """Surface points of a part with the sets that they make.

    Parameters
    ----------
    atlas : SurfaceAtlas
    center : (3,) array [m]
        Centre of mass.
    max_radius : float [m]
    friction : float
        Of the fingers.
    rng : numpy Generator
        Chooses which of the atlas' points are looked at.
    """

    def __init__(
        self,
        atlas: SurfaceAtlas,
        center: Array,
        max_radius: float,
        friction: float,
        rng: np.random.Generator,
    ):
        n = min(_POINTS, len(atlas.points))
        points = atlas.points[rng.choice(len(atlas.points), n, replace=False)]
        gradient = atlas.surface.gradient(points)
        length = np.linalg.norm(gradient, axis=1)
        good = length > SMALLEST_GRADIENT
        self._points, length = points[good], length[good]
        self._normals = gradient[good] / length[:, None]
        self._center, self._scale = center, _CENTER_RATIO * max_radius
        self._cone = np.arctan(friction)
        self._flat = self._flatness(atlas)
        self._rng = rng

    def pairs(self, widest: float) -> ContactSets:
        """Pairs up to `widest` [m] apart; some 40 ms."""
        p, n = self._points, self._normals
        i, j = np.triu_indices(len(p), 1)
        facing = np.einsum("ij,kj->ik", n, n)[i, j] < np.cos(np.pi - 2.0 * self._cone)
        i, j = i[facing], j[facing]
        way = p[j] - p[i]
        width = np.linalg.norm(way, axis=1)
        fits = (width > _NARROWEST_M) & (width < widest)
        i, j, way, width = i[fits], j[fits], way[fits], width[fits]
        axis = way / width[:, None]
        angles = np.stack(
            [_angle(-np.einsum("ij,ij->i", n[i], axis)), _angle(np.einsum("ij,ij->i", n[j], axis))]
        )
        return self._sets(np.stack([i, j], axis=1), angles.max(axis=0))

    def triples(self, widest: float) -> ContactSets:
        """Triples whose sides are up to `widest` [m]; some 20 ms."""
        p, n = self._points, self._normals
        index = self._rng.integers(len(p), size=(_TRIPLES, 3))
        center = p[index].mean(axis=1, keepdims=True)
        way = center - p[index]
        reach = np.linalg.norm(way, axis=2)
        fits = (reach > _NARROWEST_M).all(axis=1) & (reach < widest).all(axis=1)
        index, way, reach = index[fits], way[fits], reach[fits]
        angles = _angle(-np.einsum("nki,nki->nk", way, n[index]) / reach)
        return self._sets(index, angles.max(axis=1))

    def _sets(self, index: Index, angle: Array) -> ContactSets:
        """Sets of points (n, k) whose worst angle to a normal is `angle` (n,) [rad]."""
        within = angle < self._cone
        index, angle = index[within], angle[within]
        points = self._points[index]
        off = np.linalg.norm(points.mean(axis=1) - self._center, axis=1) / self._scale
        weight = (1.0 - angle / self._cone) * np.exp(-off) * self._flat[index].min(axis=1)
        if len(weight) > _KEPT:
            kept = self._rng.choice(len(weight), _KEPT, replace=False)
            index, points, weight = index[kept], points[kept], weight[kept]
        total = weight.sum()
        return ContactSets(points, self._normals[index], weight / total if total > 0.0 else weight)

    def _flatness(self, atlas: SurfaceAtlas) -> Array:
        """How little the normal changes within a fingertip, (n,) from 0 to 1."""
        basis = np.stack([tangent_basis(normal) for normal in self._normals])
        change = np.zeros(len(self._points))
        for side in (0, 1):
            beside = self._points + _FINGERTIP_M * basis[:, :, side]
            gradient = atlas.surface.gradient(beside)
            gradient /= np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-9)
            change = np.maximum(change, np.linalg.norm(gradient - self._normals, axis=1))
        return np.asarray(1.0 / (1.0 + change**2))


def _angle(cosine: Array) -> Array:
    return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))
