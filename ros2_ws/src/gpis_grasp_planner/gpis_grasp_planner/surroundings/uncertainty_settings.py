"""Settings of the hold probability, apart from its code: the node declares them as parameters."""

from __future__ import annotations

from dataclasses import dataclass

from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class UncertaintySettings(SettingsGroup):
    """How the hold probability under an uncertain pose is estimated."""

    method: str = setting(
        "sampled",
        choices=("sampled", "unscented", "none"),
        description="Perturbations at random, or the sigma points of the unscented transform; "
        "none: covariances are not looked at.",
        common=True,
    )
    samples: int = setting(
        64, low=2, high=10_000, description="Random perturbations per grasp, about 2 ms each."
    )
    sigma_kappa: float = setting(
        1.0,
        low=0.0,
        high=10.0,
        description="Kappa of the sigma points: weight of the unperturbed pose, and their reach.",
    )
    candidates: int = setting(
        20,
        low=1,
        high=200,
        description="Grasps that are tried under a covariance, best first; at least as many as are "
        "asked for.",
    )
    min_epsilon: float = setting(
        0.01, low=0.0, high=1.0, description="Epsilon above which a disturbed grasp counts as held."
    )
    give_way_m: float = setting(
        0.02,
        low=0.0,
        high=0.05,
        description="How far the part gives way to an open hand that arrives in it; 0: a miss.",
    )
    draw_in_m: float = setting(
        0.01,
        low=0.0,
        high=0.05,
        description="How far closing fingers draw back a part that was planned to touch the palm; "
        "0: it stays.",
    )
    contact_deviation_m: float = setting(
        0.004,
        low=1e-4,
        high=1.0,
        description="Of a point cloud's part: standard deviation of the surface at the contacts at "
        "which a grasp's objective is halved.",
    )
