"""Grasp wrench space and its two measures, epsilon and volume (Ferrari and Canny, 1992).

Every contact's friction cone is replaced by a pyramid of `cone_edges` edges, each with a normal
component of 1. The wrench of an edge f at p is ``[f; (p - c) x f / s]`` with the centre of mass c
and the torque scale s, the largest distance of the surface from c. The grasp wrench space is the
convex hull of the edges of all contacts (the L1 space). These are the definitions of the
simulator that the paper was evaluated in, so that figures can be compared with its tables.

Epsilon is the distance of the origin from the nearest facet, or -1 where the origin is not
inside (no force closure); volume is the plain 6-D volume of the hull, positive also without
force closure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import NO_FORCE_CLOSURE, Quality

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

Array = NDArray[np.float64]

_FLAT = 1e-9  # singular value under which wrenches do not span a direction


def tangents(normals: Array) -> tuple[Array, Array]:
    """Two tangents (k, 3) per unit normal (k, 3); the first one has no x component.

    The first tangent fixes where the pyramid's edges lie on the cone, and with it the third digit
    of epsilon. ``t_x = (n x e_x) x n``, ``t_y = n x e_x`` (e_z instead of e_x for a normal along
    x) is the choice that reproduces the original simulator's figures.
    """
    along_x = np.abs(normals[:, 0]) > 1.0 - 1e-7
    reference = np.where(along_x[:, None], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    t_y = np.cross(normals, reference)
    t_y /= np.linalg.norm(t_y, axis=1, keepdims=True)
    return np.cross(t_y, normals), t_y


def cone_edges_of(contacts: Contacts, cone_edges: int) -> Array:
    """Edges of the friction pyramids, (k, m, 3): ``n + mu (cos a t_x + sin a t_y)``."""
    angle = 2.0 * np.pi * np.arange(cone_edges) / cone_edges
    t_x, t_y = tangents(contacts.normals_inward)
    ring = np.cos(angle)[None, :, None] * t_x[:, None] + np.sin(angle)[None, :, None] * t_y[:, None]
    return np.asarray(contacts.normals_inward[:, None] + contacts.friction[:, None, None] * ring)


def contact_wrenches(
    contacts: Contacts, center_of_mass: Array, torque_scale: float, cone_edges: int = 8
) -> Array:
    """Wrenches ``[force; torque / torque_scale]`` of all pyramid edges, (k * cone_edges, 6)."""
    force = cone_edges_of(contacts, cone_edges)
    arm = (contacts.positions - center_of_mass)[:, None]
    torque = np.cross(np.broadcast_to(arm, force.shape), force) / torque_scale
    return np.concatenate([force, torque], axis=2).reshape(-1, 6)


def hull_quality(wrenches: Array) -> Quality:
    """Epsilon and volume of the convex hull of wrenches (n, 6); exact. 5-100 ms (Qhull).

    Wrenches that span less than six dimensions have volume 0 and no force closure.
    """
    hull = _hull(wrenches)
    if hull is None:
        return Quality(NO_FORCE_CLOSURE, 0.0)
    nearest = float(np.min(-hull.equations[:, -1]))
    return Quality(nearest if nearest > _FLAT else NO_FORCE_CLOSURE, float(hull.volume))


def weakest_direction(wrenches: Array) -> Array | None:
    """Unit wrench (6,) in which the hand can push the object least; None where they are flat.

    The outward normal of the hull's facet that is nearest to the origin: epsilon is how far the
    hull reaches along it. With force closure, a disturbance against it is the one that the grasp
    resists least.
    """
    hull = _hull(wrenches)
    if hull is None:
        return None
    return np.array(hull.equations[np.argmin(-hull.equations[:, -1]), :-1])


def _hull(wrenches: Array) -> ConvexHull | None:
    from scipy.spatial import ConvexHull, QhullError  # 35 MB that the node saves

    if len(wrenches) < 7 or np.linalg.matrix_rank(wrenches - wrenches[0], tol=_FLAT) < 6:
        return None
    # Contacts on one plane make many wrenches cospherical, which Qhull may refuse to merge; moving
    # each at random by far less than any figure's digits decides what belongs to which facet.
    for shift in (0.0, 1e-11, 1e-10, 1e-9):
        moved = np.random.default_rng(0).normal(scale=shift, size=wrenches.shape)
        try:
            return ConvexHull(wrenches + moved)
        except QhullError:
            continue
    return None


def grasp_quality(
    contacts: Contacts, center_of_mass: Array, torque_scale: float, cone_edges: int = 8
) -> Quality:
    """Exact epsilon and volume of a grasp; see the module's text for the definitions."""
    if len(contacts) == 0:
        return Quality(NO_FORCE_CLOSURE, 0.0)
    return hull_quality(contact_wrenches(contacts, center_of_mass, torque_scale, cone_edges))
