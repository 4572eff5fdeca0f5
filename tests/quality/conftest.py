"""Random grasps for the tests of the wrench space."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gpis_grasp_planner.quality.contacts import Contacts


def of(positions, normals_inward, friction) -> Contacts:
    k = len(positions)
    normals = np.asarray(normals_inward, dtype=float)
    return Contacts(
        np.asarray(positions, dtype=float),
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        np.broadcast_to(np.asarray(friction, dtype=float), (k,)).copy(),
        np.zeros(k, dtype=np.intp),
    )


def random_grasp(rng: np.random.Generator) -> Contacts:
    """A grasp of an ellipsoid: 3 to 9 contacts, some of them patches on one plane, as a pad has."""
    axes = rng.uniform(0.4, 1.0, 3)
    positions, normals = [], []
    for _ in range(rng.integers(3, 6)):
        u = rng.normal(size=3)
        p = axes * u / np.linalg.norm(u)
        n = -p / axes**2
        patch = rng.integers(1, 4)
        side = np.cross(n, rng.normal(size=3))
        side *= 0.1 / np.linalg.norm(side)
        for j in range(patch):
            positions.append(p + j * side)
            normals.append(n)
    return of(positions[:9], normals[:9], rng.uniform(0.2, 0.8))


@pytest.fixture
def grasp_of() -> Callable[..., Contacts]:
    """Contacts from positions, normals and friction."""
    return of


@pytest.fixture
def random_grasps(rng: np.random.Generator) -> Callable[[int], list[Contacts]]:
    """That many random grasps of ellipsoids about the origin with radii up to 1."""
    return lambda n: [random_grasp(rng) for _ in range(n)]
