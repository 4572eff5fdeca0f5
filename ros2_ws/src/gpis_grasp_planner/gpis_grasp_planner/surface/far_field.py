"""Where the local posteriors end and the signed distance to the nearest sample takes over.

The samples lie on the surface, so the distance to the nearest of them is the distance to the
surface up to (spacing / distance)^2 / 2 of itself, while a posterior extrapolated over several
spacings in front of a thin wall grows too fast and has no bound.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# The far field takes over between these distances to the nearest sample, over the radius of the
# local patches. A point of the surface between its samples is nearer than the first.
BAND = (0.35, 0.65)
# ... and where the sum of the patches' weights falls below this (a patch's centre weighs 1).
FADE_WEIGHT = 0.01


def posterior_share(
    distance: Array, direction: Array, S: Array, dS: Array, reach: Array, d_reach: Array
) -> tuple[Array, Array]:
    """Share (m,) in [0, 1] of the posterior against the far field, and its gradient (m, 3).

    A product of two smooth steps: over the distance to the nearest sample, measured by the local
    radius of the patches, and over the sum of the patches' weights where they fade out.
    """
    safe = np.where(S > 0.0, S, 1.0)
    radius = np.where(S > 0.0, reach / safe, 1.0)
    d_radius = (d_reach - radius[:, None] * dS) / safe[:, None]
    t = distance / radius
    dt = (direction - t[:, None] * d_radius) / radius[:, None]
    fade, d_fade = _smooth_step((t - BAND[0]) / (BAND[1] - BAND[0]))
    d_fade = d_fade / (BAND[1] - BAND[0])
    rise, d_rise = _smooth_step(S / FADE_WEIGHT)
    share = (1.0 - fade) * rise
    gradient = ((1.0 - fade) * d_rise / FADE_WEIGHT)[:, None] * dS
    return share, gradient - (rise * d_fade)[:, None] * dt


def _smooth_step(t: Array) -> tuple[Array, Array]:
    """0 below 0, 1 above 1, ``3 t^2 - 2 t^3`` between; and its derivative."""
    t = t.clip(0.0, 1.0)
    return t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t)
