"""The protocol under an uncertain pose: the part lies elsewhere than was thought, seeded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.surroundings.hold_probability import covariance_root
from gpis_grasp_planner.verification.protocol import verify
from gpis_grasp_planner.verification.result import Verification
from gpis_grasp_planner.verification.settings import VerificationSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class NoiseVerification:
    """The verdicts over one grasp on displaced parts."""

    seed: int
    repeats: tuple[Verification, ...]

    @property
    def share_held(self) -> float:
        """Share of the displacements under which all six directions passed."""
        return float(np.mean([repeat.held for repeat in self.repeats]))

    def as_dict(self) -> dict[str, Any]:
        """Seed, share and every repeat, ready for JSON."""
        return {
            "seed": self.seed,
            "share_held": self.share_held,
            "repeats": [repeat.as_dict() for repeat in self.repeats],
        }


def random_displacement(
    rng: np.random.Generator, distance_m: float, angle_rad: float, center: Array
) -> Array:
    """A turn by `angle_rad` about `center` (3,), then a shift by `distance_m`: (4, 4).

    Both in directions that are uniform on the sphere.
    """
    axis, way = rng.normal(size=(2, 3))
    R = Rotation.from_rotvec(angle_rad * axis / np.linalg.norm(axis)).as_matrix()
    shift = distance_m * way / np.linalg.norm(way)
    return transform(R, center + shift - R @ center)


def displacements(part: Part, settings: VerificationSettings, seed: int) -> list[Array]:
    """As many displacements (4, 4) as the settings ask for; the same seed gives the same."""
    rng = np.random.default_rng(seed)
    angle = np.radians(settings.noise_deg)
    return [
        random_displacement(rng, settings.noise_m, angle, part.center_of_mass)
        for _ in range(settings.noise_repeats)
    ]


def noise_displacements(
    normals: Array, part: Part, settings: VerificationSettings, covariance: Array | None = None
) -> list[Array]:
    """Displacements (4, 4) of a part whose pose is uncertain, from standard normals (n, 6).

    With a covariance (6, 6), translation first, of the pose in the object's axes: by that. Else
    each axis by `pose_noise_m`, and turns about each axis through the centre of mass by
    `pose_noise_deg`.
    """
    if covariance is not None:
        drawn, center = normals @ covariance_root(covariance).T, np.zeros(3)
    else:
        turn = np.radians(settings.pose_noise_deg)
        drawn = normals * np.repeat([settings.pose_noise_m, turn], 3)
        center = part.center_of_mass
    R = Rotation.from_rotvec(drawn[:, 3:]).as_matrix()
    return [
        transform(turn, center + shift - turn @ center)
        for turn, shift in zip(R, drawn[:, :3], strict=True)
    ]


def verify_under_noise(
    part: Part,
    hand: HandDescription,
    grasps: Sequence[Grasp],
    settings: VerificationSettings | None = None,
    seed: int = 0,
    processes: int = 1,
) -> list[NoiseVerification]:
    """Try every grasp on the same displaced parts: 5 mm and 5 degrees by default.

    The palm comes to where it was planned and stops before it would meet the part; the fingers
    close as they do. Results are in the order of the grasps; the same seed gives the same
    displacements.
    """
    settings = settings or VerificationSettings()
    moves = displacements(part, settings, seed)
    tried = [grasp for grasp in grasps for _ in moves]
    found = verify(part, hand, tried, settings, processes, displacements=moves * len(grasps))
    n = len(moves)
    return [
        NoiseVerification(seed, tuple(found[n * index : n * (index + 1)]))
        for index in range(len(grasps))
    ]
