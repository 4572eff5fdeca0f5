"""Compiled evaluation of the blended local posteriors: value and gradient of many points."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.surface.kernels import radial

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]


@njit(inline="always")
def wendland(t: float) -> tuple[float, float]:
    """Wendland's C2 weight ``(1 - t)^4 (4 t + 1)`` and its derivative over t, divided by t."""
    if t >= 1.0:
        return 0.0, 0.0
    s = 1.0 - t
    return s**4 * (4.0 * t + 1.0), -20.0 * s**3


@njit
def evaluate(
    x: Array,
    low: Array,
    cell: float,
    size: IntArray,
    offset: IntArray,
    cell_patch: IntArray,
    center: Array,
    scale: Array,
    radius: Array,
    start: IntArray,
    local: Array,
    weights: Array,
    trend: Array,
    kind: int,
    a: float,
    variance: float,
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Sums of the blend at points `x` (n, 3).

    Returns
    -------
    total : (n,) array
        ``sum_j w_j``.
    total_gradient : (n, 3) array [1/m]
    value : (n,) array [m]
        ``sum_j w_j f_j``.
    value_gradient : (n, 3) array
    reach : (n,) array [m]
        ``sum_j w_j s_j`` with the radius s_j of the samples of a patch.
    reach_gradient : (n, 3) array
    """
    n = x.shape[0]
    total = np.zeros(n)
    total_gradient = np.zeros((n, 3))
    value = np.zeros(n)
    value_gradient = np.zeros((n, 3))
    reach = np.zeros(n)
    reach_gradient = np.zeros((n, 3))
    for i in range(n):
        cx = math.floor((x[i, 0] - low[0]) / cell)
        cy = math.floor((x[i, 1] - low[1]) / cell)
        cz = math.floor((x[i, 2] - low[2]) / cell)
        if cx < 0 or cy < 0 or cz < 0 or cx >= size[0] or cy >= size[1] or cz >= size[2]:
            continue
        index = (int(cx) * size[1] + int(cy)) * size[2] + int(cz)
        for slot in range(offset[index], offset[index + 1]):
            j = cell_patch[slot]
            dx = x[i, 0] - center[j, 0]
            dy = x[i, 1] - center[j, 1]
            dz = x[i, 2] - center[j, 2]
            distance = math.sqrt(dx * dx + dy * dy + dz * dz)
            if distance >= radius[j]:
                continue
            w, slope = wendland(distance / radius[j])
            slope /= radius[j] * radius[j]
            qx, qy, qz = dx / scale[j], dy / scale[j], dz / scale[j]
            f = 0.0
            gx = 0.0
            gy = 0.0
            gz = 0.0
            for p in range(start[j], start[j + 1]):
                ex = qx - local[p, 0]
                ey = qy - local[p, 1]
                ez = qz - local[p, 2]
                k, b, c = radial(kind, a, math.sqrt(ex * ex + ey * ey + ez * ez))
                along = ex * weights[p, 1] + ey * weights[p, 2] + ez * weights[p, 3]
                f += k * weights[p, 0] + b * along
                h = c * along - b * weights[p, 0]
                gx += b * weights[p, 1] + h * ex
                gy += b * weights[p, 2] + h * ey
                gz += b * weights[p, 3] + h * ez
            f = variance * f + trend[j, 0]
            f += trend[j, 1] * qx + trend[j, 2] * qy + trend[j, 3] * qz
            f *= scale[j]
            total[i] += w
            value[i] += w * f
            total_gradient[i, 0] += slope * dx
            total_gradient[i, 1] += slope * dy
            total_gradient[i, 2] += slope * dz
            reach[i] += w * scale[j]
            reach_gradient[i, 0] += slope * scale[j] * dx
            reach_gradient[i, 1] += slope * scale[j] * dy
            reach_gradient[i, 2] += slope * scale[j] * dz
            value_gradient[i, 0] += w * (variance * gx + trend[j, 1]) + f * slope * dx
            value_gradient[i, 1] += w * (variance * gy + trend[j, 2]) + f * slope * dy
            value_gradient[i, 2] += w * (variance * gz + trend[j, 3]) + f * slope * dz
    return total, total_gradient, value, value_gradient, reach, reach_gradient
