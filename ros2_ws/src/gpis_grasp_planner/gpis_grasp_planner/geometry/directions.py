"""Directions spread evenly over the sphere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def even_directions(count: int) -> NDArray[np.float64]:
    """Unit vectors (count, 3) on a spiral from +z to -z that turns by the golden angle."""
    k = np.arange(count)
    z = 1.0 - (2.0 * k + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * k
    ring = np.sqrt(1.0 - z**2)
    return np.column_stack([ring * np.cos(turn), ring * np.sin(turn), z])
