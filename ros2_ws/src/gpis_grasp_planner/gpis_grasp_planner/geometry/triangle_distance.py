"""The point of a triangle that is nearest to a given point, compiled."""

from __future__ import annotations

from gpis_grasp_planner.compiled import njit


@njit(allocates=False)
def nearest_on_triangle(px, py, pz, triangles, f, out):  # type: ignore[no-untyped-def]
    """Nearest point of triangle f of `triangles` (m, 3, 3) to p, into `out` (3,).

    Found by the Voronoi regions of the triangle's features. Returns the squared distance, and
    whether the point lies strictly inside the face (not on an edge or a corner). A triangle
    without area has its corner a as nearest point where no edge decides.
    """
    ax, ay, az = triangles[f, 0, 0], triangles[f, 0, 1], triangles[f, 0, 2]
    bx, by, bz = triangles[f, 1, 0], triangles[f, 1, 1], triangles[f, 1, 2]
    cx, cy, cz = triangles[f, 2, 0], triangles[f, 2, 1], triangles[f, 2, 2]
    abx, aby, abz = bx - ax, by - ay, bz - az
    acx, acy, acz = cx - ax, cy - ay, cz - az
    apx, apy, apz = px - ax, py - ay, pz - az
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    inside = False
    if d1 <= 0.0 and d2 <= 0.0:
        v, w = 0.0, 0.0
    else:
        bpx, bpy, bpz = px - bx, py - by, pz - bz
        d3 = abx * bpx + aby * bpy + abz * bpz
        d4 = acx * bpx + acy * bpy + acz * bpz
        cpx, cpy, cpz = px - cx, py - cy, pz - cz
        d5 = abx * cpx + aby * cpy + abz * cpz
        d6 = acx * cpx + acy * cpy + acz * cpz
        va = d3 * d6 - d5 * d4
        vb = d5 * d2 - d1 * d6
        vc = d1 * d4 - d3 * d2
        if d3 >= 0.0 and d4 <= d3:
            v, w = 1.0, 0.0
        elif d6 >= 0.0 and d5 <= d6:
            v, w = 0.0, 1.0
        elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
            v, w = d1 / (d1 - d3), 0.0
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
            v, w = 0.0, d2 / (d2 - d6)
        elif va <= 0.0 and (d4 - d3) >= 0.0 and (d5 - d6) >= 0.0:
            w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
            v = 1.0 - w
        else:
            total = va + vb + vc
            if total == 0.0:
                v, w = 0.0, 0.0
            else:
                v, w = vb / total, vc / total
                inside = True
    x, y, z = v * abx + w * acx, v * aby + w * acy, v * abz + w * acz
    out[0], out[1], out[2] = ax + x, ay + y, az + z
    x, y, z = apx - x, apy - y, apz - z
    return x * x + y * y + z * z, inside
