"""Charts of the implicit surface: the tangent basis of eq. (4) and the map to points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.surface.implicit_surface import ImplicitSurface

Array = NDArray[np.float64]

# |grad f| is about 1 at the surface; below this its direction means nothing.
SMALLEST_GRADIENT = 1e-3


@dataclass(frozen=True, eq=False)
class Chart:
    """Local coordinates u in R^2 about a point of the surface.

    Attributes
    ----------
    center : (3,) array [m]
    basis : (3, 2) array
        Phi of eq. (4): orthonormal, orthogonal to the gradient, and right-handed with the
        normal: ``basis[:, 0] x basis[:, 1] = normal_outward``.
    normal_outward : (3,) array
        Unit vector along the gradient of f_GPIS. It points out of the object; the palm's z must
        point against it (the paper leaves this sign open).
    """

    center: Array
    basis: Array
    normal_outward: Array

    @classmethod
    def at(cls, surface: ImplicitSurface, point: ArrayLike) -> Chart:
        """Chart at a point (3,) on (or near) the surface.

        Raises
        ------
        MeshError
            Code MESH_DEGENERATE where the gradient vanishes: no tangent plane.
        """
        center = np.asarray(point, dtype=np.float64)
        gradient = surface.gradient(center[None])[0]
        length = float(np.linalg.norm(gradient))
        if length < SMALLEST_GRADIENT:
            raise MeshError(
                f"The gradient of the implicit surface at {center.tolist()} has the length "
                f"{length:.2g} (at least {SMALLEST_GRADIENT:g} is needed for a tangent plane). "
                "Choose a point nearer to the surface, or sample it more densely.",
                ErrorCode.MESH_DEGENERATE,
            )
        normal = gradient / length
        return cls(center.copy(), tangent_basis(normal), normal)

    def points(self, u: ArrayLike) -> Array:
        """``x' = x + Phi u`` for u (n, 2) [m]: points (n, 3) of the tangent plane."""
        return self.center + np.asarray(u, dtype=np.float64) @ self.basis.T

    def surface_points(self, surface: ImplicitSurface, u: ArrayLike) -> Array:
        """As :meth:`points`, then brought back on the zero set, (n, 3)."""
        return project(surface, self.points(u))[0]


def tangent_basis(normal: ArrayLike) -> Array:
    """Solve eq. (4), ``[grad^T; Phi^T] Phi = [0; I]``, for Phi (3, 2) by a QR decomposition.

    The complete Q of the 3 x 1 matrix of the normal has Phi as its last two columns. The sign is
    settled so that Phi's columns and the normal are right-handed.
    """
    n = np.asarray(normal, dtype=np.float64)
    q, _ = np.linalg.qr(n[:, None], mode="complete")
    basis = q[:, 1:]
    if np.cross(basis[:, 0], basis[:, 1]) @ n < 0.0:
        basis = basis[:, ::-1]
    return np.ascontiguousarray(basis)


def project(
    surface: ImplicitSurface,
    points: ArrayLike,
    tolerance_m: float = 1e-7,
    max_iterations: int = 20,
) -> tuple[Array, NDArray[np.bool_]]:
    """Newton steps along the gradient to the zero set.

    Parameters
    ----------
    points : (n, 3) array [m]
    tolerance_m : float
        Ends where |f| is below.
    max_iterations : int

    Returns
    -------
    points : (n, 3) array [m]
    converged : (n,) bool array
        False where the gradient vanished or |f| stayed above the tolerance.
    """
    x = np.array(points, dtype=np.float64)
    active = np.arange(len(x))
    converged = np.zeros(len(x), dtype=bool)
    for _ in range(max_iterations):
        f, gradient = surface.value_and_gradient(x[active])
        done = np.abs(f) <= tolerance_m
        converged[active[done]] = True
        squared = np.einsum("ij,ij->i", gradient, gradient)
        go = ~done & (squared > SMALLEST_GRADIENT**2)
        active = active[go]
        if not len(active):
            break
        x[active] -= (f[go] / squared[go])[:, None] * gradient[go]
    return x, converged
