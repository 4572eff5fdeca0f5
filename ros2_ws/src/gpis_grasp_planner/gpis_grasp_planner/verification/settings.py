"""Settings of the strict protocol and of the physics behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gpis_grasp_planner.settings import SettingsGroup, setting

if TYPE_CHECKING:  # it needs SciPy, and settings are read by commands that compute nothing
    from gpis_grasp_planner.hand.description import HandDescription
    from gpis_grasp_planner.hand.drive_train import Drive

ENGINE_CHOICES = ("auto", "bullet", "mujoco", "both")


@dataclass(frozen=True)
class VerificationSettings(SettingsGroup):
    """The strict protocol; the physics' figures were chosen by the study in the documentation."""

    engine: str = setting(
        "auto",
        choices=ENGINE_CHOICES,
        description="Physics engine of the trials: mujoco where it is installed, else bullet; with "
        "both a grasp has to hold in each.",
        common=True,
    )
    friction: float = setting(
        0.6,
        low=0.0,
        high=5.0,
        description="Coulomb friction between hand and object.",
        common=True,
    )
    palm_friction_share: float = setting(
        1.0,
        low=0.0,
        high=500.0,
        description="Friction of the palm's links over that of the fingers. The trial that decides "
        "whether a grasp of a plan holds has the planned palm's, where that is less.",
    )
    mass_kg: float = setting(
        0.1, low=1e-3, high=6.0, description="Mass of the object.", common=True
    )
    low_friction: float = setting(
        0.3, low=0.0, high=5.0, description="Friction of slippery fingers: the least that is drawn."
    )
    high_friction: float = setting(
        0.8, low=0.0, high=5.0, description="The most friction that is drawn."
    )
    pose_noise_m: float = setting(
        0.002,
        low=0.0,
        high=0.1,
        description="Standard deviation of the part's place along each axis in the drawn trials, "
        "where the request tells no covariance.",
    )
    pose_noise_deg: float = setting(
        2.0, low=0.0, high=90.0, description="The same of its turn about each axis."
    )
    draws: int = setting(
        12,
        low=0,
        high=1000,
        description="Draws of friction, mass and pose by which the probability to hold is "
        "estimated, for the grasps whose order it decides.",
        common=True,
    )
    payload_kg: float = setting(
        6.0,
        low=0.01,
        high=100.0,
        description="Parts whose stated mass is more are refused; where it was only assumed they "
        "are tried with mass_kg.",
    )
    acceleration_m_s2: float = setting(
        15.0, low=0.0, high=100.0, description="Acceleration along each of six directions."
    )
    duration_s: float = setting(
        2.0, low=0.01, high=20.0, description="How long each direction is tried."
    )
    slip_limit_m: float = setting(
        0.03, low=0.0, high=0.5, description="Largest motion of the object relative to the palm."
    )
    rotation_limit_deg: float = setting(
        15.0, low=0.0, high=180.0, description="Largest turn of the object relative to the palm."
    )
    penetration_limit_m: float = setting(
        1e-3, low=0.0, high=0.01, description="Deepest penetration at the start."
    )
    tip_force_n: float = setting(
        15.0,
        low=0.1,
        high=100.0,
        description="Force with which a fingertip presses, where the hand's description has none.",
    )
    holding_force_n: float = setting(
        20.0,
        low=0.1,
        high=1000.0,
        description="Force a fingertip resists when driven back, where the hand's description has "
        "none.",
    )
    closing_speed_rad_s: float = setting(
        1.2, low=0.05, high=5.0, description="Speed of the inner joints while closing."
    )
    closing_time_s: float = setting(
        2.0, low=0.1, high=20.0, description="Time after which closing is ended."
    )
    settling_time_s: float = setting(
        0.15, low=0.0, high=5.0, description="Time between the closing and the push."
    )
    noise_m: float = setting(
        0.005,
        low=0.0,
        high=0.1,
        description="Distance by which a displaced part is moved.",
        common=True,
    )
    noise_deg: float = setting(
        5.0,
        low=0.0,
        high=90.0,
        description="Angle by which a displaced part is turned.",
        common=True,
    )
    noise_repeats: int = setting(
        5, low=1, high=1000, description="Displacements that are tried per grasp."
    )
    lift_m: float = setting(0.2, low=0.0, high=2.0, description="Height of the table lift.")
    shake_m: float = setting(
        0.03, low=0.0, high=0.2, description="Way of the shake after the lift, each way."
    )
    processes: int = setting(
        2,
        low=1,
        high=64,
        description="Finalists that are tried at a time, if there are cores.",
        common=True,
    )
    trial_limit_s: float = setting(
        10.0,
        low=0.5,
        high=600.0,
        description="Computing time after which one trial is given up as hung [s].",
    )
    budget_share: float = setting(
        0.2,
        low=0.0,
        high=0.5,
        description="Share of the time left after the preparation that is for the trials alone; "
        "before that they run beside the search.",
    )
    rate_hz: float = setting(
        480.0, low=60.0, high=10000.0, description="Bullet's time steps per second."
    )
    solver_iterations: int = setting(
        400,
        low=5,
        high=4000,
        description="Iterations of Bullet's contact solver in a step, for 0.1 kg.",
    )
    mujoco_rate_hz: float = setting(
        960.0, low=60.0, high=10000.0, description="MuJoCo's time steps per second."
    )
    cover_tolerance_m: float = setting(
        2e-4, low=2e-5, high=2e-3, description="How far convex pieces may stand out of the object."
    )

    def link_friction_shares(self, hand: HandDescription) -> list[float]:
        """Friction of each link of a hand over `friction`."""
        of_group = {"finger": 1.0, "palm": self.palm_friction_share}
        return [of_group[group] for group in hand.link_friction_group]

    def forces_n(self, drive: Drive) -> tuple[float, float]:
        """With which a fingertip of a hand presses, and which it resists [N]."""
        press, hold = drive.tip_force_n, drive.holding_force_n
        return (
            self.tip_force_n if press is None else press,
            self.holding_force_n if hold is None else hold,
        )
