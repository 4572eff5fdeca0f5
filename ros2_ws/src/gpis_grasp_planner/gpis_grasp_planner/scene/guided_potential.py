"""The guided potential quality energy of the original simulator's EigenGrasp planner, compiled.

On the hand lie desired contacts (four on the palm, five on each finger). For each, let d be its
distance from the object [mm] and cos the agreement of its normal with the direction to the
nearest point of the object. Then

    scale = cos(pi d / 50) + 1  where cos >= 0.7 and d <= 50,  else 0

and, if at least three scales exceed 0.25, E = -epsilon of the hull of the scaled contact forces (a
friction pyramid each, torques left out), provided that this hull contains the origin; otherwise
E = mean(d + 50 (1 - cos)). So the energy first draws the contacts to the surface and, once they
are near, asks for contacts that hold the object from all sides.

The original's virtual contacts carry a friction of their own, 0.2 for every material; so here.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.geometry.triangle_tree import nearest_point
from gpis_grasp_planner.hand.link_mesh import MOST_CORNERS
from gpis_grasp_planner.scene.force_hull import force_epsilon
from gpis_grasp_planner.scene.free_hand import hand_is_free
from gpis_grasp_planner.scene.posture import place_hand

FRICTION = 0.2
EDGES = 8
REACH_MM = 50.0
MIN_COSINE = 0.7
MIN_SCALE = 0.25
MIN_CONTACTS = 3
_FAR = 10.0


@njit
def _distances(obj, R, t, links, points, normals, distance_mm, cosine, outward):  # type: ignore[no-untyped-def]
    """Distance [mm], cosine and hand normal (object's frame) of every desired contact."""
    q = np.empty(3)
    limit = _FAR
    px = py = pz = 0.0
    for i in range(links.shape[0]):
        Rl = R[links[i]]
        tl = t[links[i]]
        p = points[i]
        x = tl[0] + Rl[0, 0] * p[0] + Rl[0, 1] * p[1] + Rl[0, 2] * p[2]
        y = tl[1] + Rl[1, 0] * p[0] + Rl[1, 1] * p[1] + Rl[1, 2] * p[2]
        z = tl[2] + Rl[2, 0] * p[0] + Rl[2, 1] * p[1] + Rl[2, 2] * p[2]
        if i > 0:
            # No farther than the contact before, by the triangle inequality.
            moved = np.sqrt((x - px) ** 2 + (y - py) ** 2 + (z - pz) ** 2)
            limit = 1e-3 * distance_mm[i - 1] + moved + 1e-6
        d, _, _ = nearest_point(x, y, z, limit, obj.triangles, obj.lower, obj.upper, obj.child, q)
        n = normals[i]
        for a in range(3):
            outward[i, a] = Rl[a, 0] * n[0] + Rl[a, 1] * n[1] + Rl[a, 2] * n[2]
        cosine[i] = 1.0
        if d > 1e-9:
            cosine[i] = (
                outward[i, 0] * (q[0] - x) + outward[i, 1] * (q[1] - y) + outward[i, 2] * (q[2] - z)
            ) / d
        distance_mm[i] = 1e3 * d
        px, py, pz = x, y, z


@njit
def contact_scale(distance_mm, cosine):  # type: ignore[no-untyped-def]
    """Scale of a desired contact's wrenches, 0 to 2."""
    if cosine < MIN_COSINE or distance_mm > REACH_MM:
        return 0.0
    return np.cos(np.pi * distance_mm / REACH_MM) + 1.0


@njit
def _add_pyramid(normal, scale, forces, count):  # type: ignore[no-untyped-def]
    """Forces of one scaled pyramid; its first tangent is e_y x n, as the original's."""
    nx, ny, nz = normal[0], normal[1], normal[2]
    length = np.sqrt(nx * nx + nz * nz)
    ux, uz = (nz / length, -nx / length) if length > 1e-9 else (1.0, 0.0)
    vx, vy, vz = ny * uz, nz * ux - nx * uz, -ny * ux
    for e in range(EDGES):
        angle = 2.0 * np.pi * e / EDGES
        c = FRICTION * np.cos(angle)
        s = FRICTION * np.sin(angle)
        forces[count + e, 0] = scale * (nx + c * ux + s * vx)
        forces[count + e, 1] = scale * (ny + s * vy)
        forces[count + e, 2] = scale * (nz + c * uz + s * vz)


@njit
def potential_energy(distance_mm, cosine, outward, forces):  # type: ignore[no-untyped-def]
    """The energy of contacts (n,) at these distances, cosines and hand normals (n, 3).

    `forces` (n * EDGES, 3) is room to work in.
    """
    n = distance_mm.shape[0]
    near = 0
    count = 0
    total = 0.0
    for i in range(n):
        total += distance_mm[i] + 50.0 * (1.0 - cosine[i])
        scale = contact_scale(distance_mm[i], cosine[i])
        if scale > 0.0:
            _add_pyramid(outward[i], scale, forces, count)
            count += EDGES
        near += scale > MIN_SCALE
    if near >= MIN_CONTACTS:
        epsilon = force_epsilon(forces, count)
        if epsilon > 0.0:
            return -epsilon
    return total / n


@njit
def potential_many(hand, obj, T, joints, links, points, normals, energy):  # type: ignore[no-untyped-def]
    """Energies of hands at poses T (B, 4, 4) with joints (B, J); inf where the hand collides."""
    n_links = hand.parent.shape[0]
    n = links.shape[0]
    R = np.empty((n_links, 3, 3))
    t = np.empty((n_links, 3))
    work = np.empty((MOST_CORNERS, 3))
    other = np.empty((MOST_CORNERS, 3))
    distance_mm = np.empty(n)
    cosine = np.empty(n)
    outward = np.empty((n, 3))
    forces = np.empty((n * EDGES, 3))
    for b in range(T.shape[0]):
        place_hand(hand, joints[b], T[b], R, t)
        if not hand_is_free(hand, obj, R, t, work, other):
            energy[b] = np.inf
            continue
        _distances(obj, R, t, links, points, normals, distance_mm, cosine, outward)
        energy[b] = potential_energy(distance_mm, cosine, outward, forces)
