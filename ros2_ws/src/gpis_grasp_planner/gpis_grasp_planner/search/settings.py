"""Settings of the searches, apart from them: whoever declares parameters need not load numba.

The ROS node imports this module within its start-up time; the searches, with SciPy's optimisers
and the compiled code, are imported by the planning process alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.settings import SettingsGroup, setting


@dataclass(frozen=True)
class AdaptionSettings(SettingsGroup):
    """Parameters of the local adaption."""

    n_seed: int = setting(
        12, low=1, high=1000, description="n_seed of Alg. 2: points tried on each chart."
    )
    chart_radius_ratio: float = setting(
        0.15,
        low=0.0,
        high=1.0,
        description="Radius of u_rand on the chart, over the object's largest radius.",
    )
    standoff_max_m: float = setting(
        0.09,
        low=0.0,
        high=0.3,
        description="Seeds go back from the nearest free palm by up to this.",
    )
    standoff_share: float = setting(
        0.6, low=0.0, high=1.0, description="Share of the seeds that go back at all."
    )
    vary_spread_deg: float = setting(
        12.0,
        low=0.0,
        high=180.0,
        description="Seeds vary the pre-shape (the Barrett's spread) by this where the model "
        "proposes one.",
    )
    vary_standoff_m: float = setting(
        0.008,
        low=0.0,
        high=0.3,
        description="Seeds vary the standoff by this where the model proposes one.",
    )
    free_share: float = setting(
        0.6,
        low=0.0,
        high=1.0,
        description="Share of the seeds that draw pre-shape and standoff freely all the same.",
    )
    tilt_share: float = setting(
        0.5,
        low=0.0,
        high=1.0,
        description="Where constraints know a direction to come from, such as from above: share "
        "of the seeds whose palm is turned part of the way to it.",
    )
    spread_max_deg: float = setting(
        180.0,
        low=0.0,
        high=180.0,
        description="Largest angle of the pre-shape (the Barrett's spread) that seeds draw; a "
        "motor that slides is drawn up to its end.",
    )


@dataclass(frozen=True)
class HppSettings(SettingsGroup):
    """Parameters of HPP-Opt."""

    n_iter: int = setting(
        100_000,
        low=0,
        high=10_000_000,
        description="n_iter of Alg. 1: proposals after the start; the time budget ends earlier.",
    )
    n_initial: int = setting(
        24, low=1, high=100_000, description="Latin hypercube poses that start the model."
    )
    batch: int = setting(
        8,
        low=1,
        high=64,
        description="Proposals asked of the model at once; the paper's form is 1.",
    )
    xi: float = setting(
        0.01,
        low=0.0,
        high=10.0,
        description="xi of expected improvement, in standard deviations of the objective.",
    )
    max_observations: int = setting(
        200, low=10, high=5000, description="Observations that the model holds at once."
    )
    noise_std_max: float = setting(
        1.0,
        low=1e-4,
        high=10.0,
        description="Upper bound of the model's noise, in standard deviations of the objective: "
        "the seeds of the local adaption make it noisy.",
    )
    improvement: str = setting(
        "list",
        choices=("list", "best"),
        description="What expected improvement is over: the list of distinct grasps, or (the "
        "paper's form) the best observation.",
    )
    model_sees: str = setting(
        "adapted",
        choices=("adapted", "proposed"),
        description="Pose by which the model knows a proposal: where the local adaption takes "
        "it, or (the paper's form) as proposed.",
    )
    model_posture: bool = setting(
        True,
        description="The model also proposes pre-shape and standoff; without (the paper's form) "
        "the seeds of the local adaption draw them.",
    )
    learn_feasibility: bool = setting(
        False,
        description="What a constraint blocks lowers the probability of its neighbourhood, in "
        "place of counting as value 0.",
    )
    volume_weight: float = setting(
        0.5,
        low=0.0,
        high=100.0,
        description="lambda of the objective: epsilon + lambda volume.",
        common=True,
    )
    balance_friction_share: float = setting(
        0.67,
        low=0.0,
        high=1.0,
        description="Share of the friction by which the closing hand's own forces should balance; "
        "what they leave over lowers the objective. 0 (the paper's form): nobody asks.",
        common=True,
    )
    palm_clearance_m: float = setting(
        0.12,
        low=0.0,
        high=1.0,
        description="How far the outer box of palm positions lies beyond the object's box.",
    )


@dataclass(frozen=True)
class RefinementSettings(SettingsGroup):
    """Parameters of the contact refinement."""

    samples: int = setting(
        12, low=1, high=1000, description="Neighbours tried of a grasp before the next one's turn."
    )
    n_grasps: int = setting(
        24, low=1, high=200, description="How many distinct grasps are refined in turn."
    )
    step_min: float = setting(
        0.02, low=1e-4, high=1.0, description="Smallest relative step (of the largest ones)."
    )
    step_translation_m: float = setting(
        0.02, low=0.0, high=0.2, description="Largest standard deviation of a translation."
    )
    step_rotation_deg: float = setting(
        15.0, low=0.0, high=90.0, description="Largest standard deviation of a rotation."
    )
    step_spread_deg: float = setting(
        25.0, low=0.0, high=180.0, description="Largest standard deviation of the pre-shape."
    )
    tournament_share: float = setting(
        0.38,
        low=0.0,
        high=0.5,
        description="Share of the turns that first-stage grasps get which are not among the best.",
    )
    tournament_ratio: int = setting(
        2,
        low=2,
        high=10,
        description="One start in this many goes on, for this many times as long.",
    )
    tournament_rungs: int = setting(
        6, low=1, high=12, description="How often a start can go on, plus one."
    )
    tournament_apart: float = setting(
        1.5, low=0.0, high=10.0, description="How far starts are apart, in largest steps."
    )
    image_share: float = setting(
        0.25,
        low=0.0,
        high=0.5,
        description="Share of the turns for images of the best under the part's near symmetries.",
    )
    image_tolerance: float = setting(
        0.06,
        low=0.0,
        high=0.5,
        description="Mean distance of a part from its image up to which it counts as a symmetry, "
        "over the largest radius.",
    )


@dataclass(frozen=True)
class DualSettings(SettingsGroup):
    """How the two stages share the budget."""

    second_stage_share: float = setting(
        0.7,
        low=0.0,
        high=0.95,
        description="Share of the attempts that the second stage gets once there is a grasp.",
    )


@dataclass(frozen=True)
class ContactSettings(SettingsGroup):
    """Proposals that begin with the contacts."""

    share: float = setting(
        0.2,
        low=0.0,
        high=1.0,
        description="Largest share of the first stage's attempts whose hands are put about pairs "
        "and triples of contacts, beside those that settle on a chart; less where they are worth "
        "less.",
    )
    triple_share: float = setting(
        0.3, low=0.0, high=1.0, description="Share of the sets of contacts that are triples."
    )
    n_seed: int = setting(
        4, low=1, high=100, description="Hands (postures and rolls) tried for each set of contacts."
    )
    tell_model: bool = setting(
        False, description="Whether the model of the palm's pose learns from them, too."
    )


@dataclass(frozen=True)
class AdmmCpSettings(SettingsGroup):
    """Parameters of ADMM-CP-Opt."""

    n_seed: int = setting(
        2, low=1, high=100, description="n_seed of Alg. 3: shifts of the palm on its chart."
    )
    shift_ratio: float = setting(
        0.05,
        low=0.0,
        high=1.0,
        description="Radius of u_rand on the palm's chart, over the object's largest radius.",
    )
    neighbourhood: float = setting(
        0.2,
        low=0.01,
        high=1.0,
        description="How far motors may go from the grasp they start from, over their whole "
        "travel; 1 (the paper's form) leaves them their whole box.",
    )
    max_iterations: int = setting(
        12, low=1, high=1000, description="max_iter of Alg. 3: iterations of ADMM."
    )
    rho: float = setting(
        4.0, low=1e-6, high=1e6, description="rho of the augmented Lagrangian (scaled motors)."
    )
    penalty_per_mm2: float = setting(
        0.05, low=0.0, high=1e3, description="mu of g_c, per square millimetre of violation."
    )
    primal_tolerance: float = setting(
        0.01, low=0.0, high=1.0, description="eps^primal: largest |q - z| (scaled motors)."
    )
    dual_tolerance: float = setting(
        0.04, low=0.0, high=10.0, description="eps^dual: largest rho |z - z_previous|."
    )
    first_evaluations: int = setting(
        20, low=1, high=10_000, description="Evaluations of a sub-problem's first iteration."
    )
    update_evaluations: int = setting(
        6, low=1, high=10_000, description="Evaluations of a sub-problem's later iterations."
    )
    contact_reach_mm: float = setting(
        8.0,
        low=0.0,
        high=100.0,
        description="A link's nearest point counts as a contact in f_obj within this distance.",
    )


@dataclass(frozen=True)
class SearchSettings:
    """The groups that a search reads, and those of the scene it closes hands in."""

    scene: SceneSettings = field(default_factory=SceneSettings)
    adaption: AdaptionSettings = field(default_factory=AdaptionSettings)
    hpp: HppSettings = field(default_factory=HppSettings)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    dual: DualSettings = field(default_factory=DualSettings)
    contacts: ContactSettings = field(default_factory=ContactSettings)
    admm: AdmmCpSettings = field(default_factory=AdmmCpSettings)
