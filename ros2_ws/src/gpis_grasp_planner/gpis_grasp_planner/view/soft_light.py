"""Take the grain out of sampled light without washing it over edges."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.floating[Any]]

_NORMAL_FLOOR = 0.8  # cosine between normals at which a neighbour no longer counts
_STRIDES = (1, 2, 4)  # of three passes over 3 x 3 neighbours: a reach of 7 pixels


def smooth_light(
    light: Real, normal: Real, depth: Real, seen: NDArray[np.bool_], step: float
) -> Real:
    """Average light over neighbours on the same surface (an edge-stopping à-trous filter).

    Parameters
    ----------
    light : (h, w, c) array
        Sampled values; those of unseen pixels do not count.
    normal : (h, w, 3) array
    depth : (h, w) array [m]
    seen : (h, w) bool array
        Whether the pixel shows a surface. Unseen pixels get their neighbours' light, for a
        subpixel that does show one.
    step : float [m]
        Depth difference at which a neighbour no longer counts.

    Returns
    -------
    (h, w, c) array
    """
    depth = np.where(seen, depth, 0.0).astype(np.float32)
    valid = seen.astype(np.float32)
    for stride in _STRIDES:
        total = light * valid[..., None]
        weight_sum = valid.copy()
        for dy, dx in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
            here, there = _overlap(seen.shape, dy * stride, dx * stride)
            cosine = np.einsum("ijk,ijk->ij", normal[here], normal[there])
            weight = np.clip((cosine - _NORMAL_FLOOR) / (1.0 - _NORMAL_FLOOR), 0.0, 1.0)
            weight *= np.abs(depth[here] - depth[there]) < step * stride
            weight = np.where(seen[here], weight, 1.0) * valid[there]
            total[here] += weight[..., None] * light[there]
            weight_sum[here] += weight
        light = total / np.maximum(weight_sum, 1e-6)[..., None]
    return light


def _overlap(
    shape: tuple[int, ...], dy: int, dx: int
) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Slices of an image that pair every pixel with its neighbour (dy, dx) further."""
    pairs = [
        (slice(max(0, -d), n - max(0, d)), slice(max(0, d), n - max(0, -d)))
        for n, d in zip(shape, (dy, dx), strict=True)
    ]
    return (pairs[0][0], pairs[1][0]), (pairs[0][1], pairs[1][1])
