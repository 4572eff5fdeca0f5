"""Settings of the implicit surface: sampling of the mesh, patches, kernel and noise."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class SurfaceSettings(SettingsGroup):
    """How a mesh becomes a Gaussian process implicit surface."""

    n_samples: int = setting(
        10_000, low=50, high=50_000, description="Surface samples aimed at when a mesh is fitted."
    )
    patch_size: int = setting(
        40, low=8, high=200, description="Surface samples that each local Gaussian process holds."
    )
    patch_blend_ratio: float = setting(
        1.0,
        low=0.2,
        high=1.0,
        description="Radius at which a patch's weight ends, over the radius of its samples.",
    )
    patch_cover_ratio: float = setting(
        0.6,
        low=0.1,
        high=0.9,
        description="Samples nearer to a patch centre than this share of its blend radius need "
        "no further patch; smaller means more overlap.",
    )
    kernel: str = setting(
        "matern32",
        choices=("matern32", "matern52"),
        description="Covariance function of the local Gaussian processes.",
    )
    length_scale_ratio: float = setting(
        3.0,
        low=0.1,
        high=30.0,
        description="Length scale of the kernel over the radius of the patch's samples.",
    )
    noise_value_ratio: float = setting(
        1e-4,
        low=0.0,
        high=0.1,
        description="Standard deviation of a sample's value over the radius of the patch.",
    )
    noise_normal: float = setting(
        0.05,
        low=0.0,
        high=1.0,
        description="Standard deviation of a normal's component (about radians).",
    )
    duplicate_tolerance_m: float = setting(
        1e-7, low=0.0, high=1e-3, description="Samples closer than this are merged into one."
    )
