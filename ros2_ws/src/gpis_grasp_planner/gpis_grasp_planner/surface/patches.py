"""Local Gaussian processes on overlapping balls of surface samples, and their blend.

Each patch is the exact posterior of a Gaussian process given the values and normals of the
`patch_size` samples nearest to its centre. The blend

    f(x) = sum_j w_j(x) f_j(x) / sum_j w_j(x)

with compactly supported weights (Wendland C2 of the distance to the centre) is a weighted mean of
these Gaussian posteriors and itself a Gaussian process; it is not the posterior of one global
process, which would cost O(n^3) for all samples at once. Every zero, sign and slope that the
patches agree on is the blend's too.

Lengths inside a patch are measured from its centre in units of its radius, which keeps the
covariance matrices alike (and well scaled) for a 16 mm ball and a 300 mm housing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack
from scipy.spatial import cKDTree

from gpis_grasp_planner.compiled import njit
from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.surface import kernels
from gpis_grasp_planner.surface.settings import SurfaceSettings

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Relative to the mean of the diagonal: from rounding error to what would already be visible.
JITTER_LADDER = (0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4)
_CELLS_PER_AXIS = 96
_PATCHES_A_CALL = 50


@dataclass(frozen=True, eq=False)
class Patches:
    """All local posteriors in flat arrays, as the compiled evaluation wants them.

    Attributes
    ----------
    center : (P, 3) array [m]
    scale : (P,) array [m]
        Radius of the samples: the unit of length of the patch.
    radius : (P,) array [m]
        Where the weight ends.
    start : (P + 1,) int array
        Samples of patch j are rows ``start[j]:start[j+1]`` of the next three.
    samples : (S,) int array
        Their indices in the fitted points.
    local : (S, 3) array
        Their positions in the patch's unit and origin.
    weights : (S, 4) array
        Coefficients of value and gradient: ``(K + noise)^-1 y``.
    trend : (P, 4) array
        Constant and slope of the linear part of the mean.
    sample_reach : (n,) array [m]
        Distance of every fitted point to the last of its `patch_size` nearest.
    jitter : float
        The largest jitter that any patch needed.
    """

    center: Array
    scale: Array
    radius: Array
    start: IntArray
    samples: IntArray
    local: Array
    weights: Array
    trend: Array
    sample_reach: Array
    jitter: float


@dataclass(frozen=True)
class KernelParameters:
    """The covariance function in the patch's unit of length."""

    kind: int
    a: float
    variance: float
    trend: float
    noise_value: float
    noise_normal: float

    @classmethod
    def from_settings(cls, settings: SurfaceSettings) -> KernelParameters:
        """Signal variance such that the prior's gradient has unit length on average.

        That is the gradient of a signed distance, the function the posterior is meant to be.
        """
        a = kernels.inverse_length(settings.kernel, settings.length_scale_ratio)
        kind = kernels.KERNELS[settings.kernel]
        _, b, _ = kernels.radial(kind, a, 0.0)
        return cls(
            kind=kind,
            a=a,
            variance=1.0 / (3.0 * b),
            trend=1.0 / 3.0,
            noise_value=settings.noise_value_ratio,
            noise_normal=settings.noise_normal,
        )


def choose_centers(
    tree: cKDTree, settings: SurfaceSettings
) -> tuple[IntArray, list[IntArray], Array]:
    """Greedy cover: centres (indices of samples), the samples of each.

    The third array (n,) [m] is the distance of every point to the last of its nearest ones.
    """
    points = tree.data
    k = min(settings.patch_size, len(points))
    distance, neighbour = tree.query(points, k=k)
    distance, neighbour = np.reshape(distance, (-1, k)), np.reshape(neighbour, (-1, k))
    radius = distance[:, -1].copy()  # kept; the whole would be forty times as large
    open_ = np.ones(len(points), dtype=bool)
    centers = []
    # A fixed shuffled order: the same samples give the same patches.
    for i in np.random.default_rng(0).permutation(len(points)):
        if open_[i]:
            centers.append(i)
            near = distance[i] <= (
                settings.patch_cover_ratio * settings.patch_blend_ratio * radius[i]
            )
            open_[neighbour[i][near]] = False
    index = np.array(centers)
    return index, [neighbour[i] for i in index], radius


def fit_patches(
    points: Array,
    normals_outward: Array,
    tree: cKDTree,
    settings: SurfaceSettings,
    on_share: Callable[[float], None] = lambda _: None,
) -> Patches:
    """Fit a Gaussian process on every patch; cost about 0.2 ms each for 40 samples.

    `on_share` is called every few ms with the share that is done, and may raise to end the fit.

    Raises
    ------
    MeshError
        Code MESH_DEGENERATE if a covariance matrix stays indefinite up to the last jitter.
    """
    kernel = KernelParameters.from_settings(settings)
    center_index, members, sample_reach = choose_centers(tree, settings)
    center, scale = points[center_index], sample_reach[center_index]
    local, weights, trend = [], [], []
    largest = 0.0
    # Every patch has the same number of samples; memory fresh for each would cost more than LAPACK.
    workspace = np.empty((4 * len(members[0]), 4 * len(members[0])))
    for j, samples in enumerate(members):
        if j % _PATCHES_A_CALL == 0:
            on_share(j / len(members))
        q = (points[samples] - center[j]) / scale[j]
        y = np.zeros((len(samples), 4))
        y[:, 1:] = normals_outward[samples]
        factor, jitter = factorise(q, kernel, workspace)
        w = lapack.dpotrs(factor, y.ravel(), lower=1)[0].reshape(-1, 4)
        largest = max(largest, jitter)
        local.append(q)
        weights.append(w)
        slope = kernel.trend * (w[:, 0] @ q + w[:, 1:].sum(axis=0))
        trend.append([kernel.trend * w[:, 0].sum(), *slope])
    return Patches(
        center=center,
        scale=scale,
        radius=settings.patch_blend_ratio * scale,
        start=np.concatenate([[0], np.cumsum([len(m) for m in members])]).astype(np.int64),
        samples=np.concatenate(members).astype(np.int64),
        local=np.concatenate(local),
        weights=np.concatenate(weights),
        trend=np.array(trend),
        sample_reach=sample_reach,
        jitter=largest,
    )


def factorise(
    q: Array, kernel: KernelParameters, workspace: Array | None = None
) -> tuple[Array, float]:
    """Cholesky factor (lower, 4n x 4n) of a patch's covariance with noise, and the jitter used.

    `workspace` (4n, 4n) is overwritten by the factor, where given.
    """
    n = 4 * len(q)
    K = np.empty((n, n)) if workspace is None else workspace
    for jitter in JITTER_LADDER:
        kernels.fill_upper_covariance(kernel.kind, kernel.a, kernel.variance, kernel.trend, q, K)
        diagonal = K.reshape(-1)[:: n + 1]
        if jitter > 0.0:
            diagonal += jitter * float(diagonal.mean())
        diagonal[0::4] += kernel.noise_value**2
        for t in (1, 2, 3):
            diagonal[t::4] += kernel.noise_normal**2
        # K's transpose is in the order that LAPACK wants without a copy, and has its lower half.
        factor, info = lapack.dpotrf(K.T, lower=1, overwrite_a=1)
        if info == 0 and np.isfinite(factor[-1, -1]):
            return factor, jitter
    raise MeshError(
        f"The covariance of {len(q)} surface samples is not positive definite even with a jitter "
        f"of {JITTER_LADDER[-1]:g}. Raise noise_value_ratio or noise_normal, or thin the samples.",
        ErrorCode.MESH_DEGENERATE,
    )


@dataclass(frozen=True, eq=False)
class PatchGrid:
    """A uniform grid that tells which patches' weights reach a cell (CSR lists)."""

    low: Array
    cell: float
    size: IntArray
    offset: IntArray
    patch: IntArray


def build_grid(patches: Patches) -> PatchGrid:
    """Cells of about half the median radius, at most 96 along the longest axis."""
    low = (patches.center - patches.radius[:, None]).min(axis=0)
    high = (patches.center + patches.radius[:, None]).max(axis=0)
    longest = float((high - low).max())
    cell = max(0.5 * float(np.median(patches.radius)), longest / _CELLS_PER_AXIS)
    size = np.floor((high - low) / cell).astype(np.int64) + 1
    offset, patch = _fill_grid(patches.center, patches.radius, low, cell, size)
    return PatchGrid(low, cell, size, offset, patch)


@njit
def _fill_grid(
    center: Array, radius: Array, low: Array, cell: float, size: IntArray
) -> tuple[IntArray, IntArray]:
    n_cells = size[0] * size[1] * size[2]
    offset = np.zeros(n_cells + 1, dtype=np.int64)
    patch = np.zeros(0, dtype=np.int64)
    first = np.empty(3, dtype=np.int64)
    last = np.empty(3, dtype=np.int64)
    for counting in (True, False):
        if not counting:
            for i in range(n_cells):
                offset[i + 1] += offset[i]
            patch = np.empty(offset[n_cells], dtype=np.int64)
            cursor = offset[:-1].copy()
        for j in range(center.shape[0]):
            for t in range(3):
                first[t] = max(0, int((center[j, t] - radius[j] - low[t]) / cell))
                last[t] = min(size[t] - 1, int((center[j, t] + radius[j] - low[t]) / cell))
            for x in range(first[0], last[0] + 1):
                for y in range(first[1], last[1] + 1):
                    for z in range(first[2], last[2] + 1):
                        r2 = 0.0
                        for t, cx in ((0, x), (1, y), (2, z)):
                            lo = low[t] + cx * cell
                            gap = max(lo - center[j, t], center[j, t] - lo - cell, 0.0)
                            r2 += gap * gap
                        if r2 > radius[j] * radius[j]:
                            continue
                        i = (x * size[1] + y) * size[2] + z
                        if counting:
                            offset[i + 1] += 1
                        else:
                            patch[cursor[i]] = j
                            cursor[i] += 1
    return offset, patch
