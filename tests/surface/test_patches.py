"""Local posteriors against dense linear algebra, and the search grid against brute force."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.surface import kernels, patches
from gpis_grasp_planner.surface.implicit_surface import ImplicitSurface
from gpis_grasp_planner.surface.patches import KernelParameters, build_grid, fit_patches
from gpis_grasp_planner.surface.settings import SurfaceSettings


@pytest.mark.parametrize("kernel_name", sorted(kernels.KERNELS))
def test_a_single_patch_is_the_exact_posterior(shapes, rng, kernel_name):
    # As many samples as a patch holds, so that every patch has all of them.
    settings = SurfaceSettings(kernel=kernel_name, patch_size=30)
    points, normals = shapes.sphere_samples(30, 0.05)
    surface = ImplicitSurface.fit(points, normals, settings)
    x = 0.05 * rng.normal(size=(50, 3)) * 0.2 + points[rng.integers(30, size=50)] * 0.9

    p = fit_patches(points, normals, cKDTree(points), settings)
    k = KernelParameters.from_settings(settings)
    total, value, deviation = np.zeros((3, len(x)))
    for center, scale, radius in zip(p.center, p.scale, p.radius, strict=True):
        q, r = (points - center) / scale, (x - center) / scale
        K = kernels.covariance(k.kind, k.a, k.variance, k.trend, q, q)
        K += np.diag(np.tile([k.noise_value**2] + 3 * [k.noise_normal**2], 30))
        cross = kernels.covariance(k.kind, k.a, k.variance, k.trend, r, q)[::4]
        y = np.column_stack([np.zeros(30), normals]).ravel()
        t = np.linalg.norm(x - center, axis=1) / radius
        w = np.where(t < 1, (1 - t) ** 4 * (4 * t + 1), 0.0)
        prior = k.variance + k.trend * (1 + (r**2).sum(axis=1))
        posterior = prior - np.einsum("ij,ji->i", cross, np.linalg.solve(K, cross.T))
        total += w
        value += w * scale * (cross @ np.linalg.solve(K, y))
        deviation += w * scale * np.sqrt(posterior.clip(0))
    near = cKDTree(points).query(x)[0] < 0.3 * p.scale.min()
    assert near.sum() > 10
    np.testing.assert_allclose(surface.value(x)[near], (value / total)[near], atol=1e-9)
    expected = ((deviation / total) ** 2)[near]
    np.testing.assert_allclose(surface.variance(x)[near], expected, rtol=1e-3)


def test_every_sample_is_covered_and_every_patch_has_its_nearest(shapes):
    settings = SurfaceSettings()
    points, normals = shapes.sphere_samples(500, 0.05)
    tree = cKDTree(points)
    p = fit_patches(points, normals, tree, settings)
    assert p.jitter == 0.0
    gap = np.linalg.norm(points[:, None] - p.center[None], axis=2) / p.radius
    assert gap.min(axis=1).max() <= settings.patch_cover_ratio
    for j in range(len(p.scale)):
        expected = tree.query(p.center[j], k=settings.patch_size)[1]
        assert set(p.samples[p.start[j] : p.start[j + 1]]) == set(expected)


def test_grid_lists_every_patch_that_reaches_a_point(shapes, rng):
    points, normals = shapes.sphere_samples(400, 0.05)
    p = fit_patches(points, normals, cKDTree(points), SurfaceSettings(patch_size=20))
    grid = build_grid(p)
    x = rng.uniform(-0.08, 0.08, (2000, 3))
    reaches = np.linalg.norm(x[:, None] - p.center[None], axis=2) < p.radius
    cell = np.floor((x - grid.low) / grid.cell).astype(int)
    inside = ((cell >= 0) & (cell < grid.size)).all(axis=1)
    assert not reaches[~inside].any()
    index = (cell[:, 0] * grid.size[1] + cell[:, 1]) * grid.size[2] + cell[:, 2]
    for i in np.flatnonzero(inside):
        listed = grid.patch[grid.offset[index[i]] : grid.offset[index[i] + 1]]
        assert set(np.flatnonzero(reaches[i])) <= set(listed)


def test_jitter_ladder_climbs_where_samples_coincide():
    exact = KernelParameters(kernels.MATERN_52, 0.01, 1.0, 0.3, 0.0, 0.0)
    q = np.repeat(np.eye(3), 4, axis=0)
    factor, jitter = patches.factorise(q, exact)
    assert jitter in patches.JITTER_LADDER[1:]
    assert np.isfinite(factor).all()


def test_a_hopeless_covariance_is_an_error_and_no_nan():
    broken = KernelParameters(kernels.MATERN_32, 1.0, -1.0, 0.0, 0.0, 0.0)
    with pytest.raises(MeshError, match="not positive definite") as caught:
        patches.factorise(np.eye(3), broken)
    assert caught.value.code == ErrorCode.MESH_DEGENERATE


def test_the_share_done_is_told_and_may_end_the_fit(shapes):
    points, normals = shapes.sphere_samples(1500, 0.05)
    tree, shares = cKDTree(points), []
    fit_patches(points, normals, tree, SurfaceSettings(), shares.append)
    assert shares[0] == 0.0
    assert shares == sorted(shares)
    assert shares[-1] < 1.0

    def end(share):
        if share > 0.0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_patches(points, normals, tree, SurfaceSettings(), end)
