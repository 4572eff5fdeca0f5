"""The pre-shape: what a hand sets before it closes, and keeps while it does.

Each of its motors is one figure, such as the Barrett's spread; joints follow the motors with gains.
A hand has any number of them, also none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError

Array = NDArray[np.float64]

SLIDING_LEVER_M = 0.05


@dataclass(frozen=True, eq=False)
class Preshape:
    """S motors and the P joints that closing does not move.

    Attributes
    ----------
    names : tuple of str
    lower, upper, speed : (S,) arrays [rad and rad/s, or m and m/s]
    unit : (S,) array
        What counts as 1 rad: 1, or a lever of 50 mm for a motor whose joints slide.
    joints : (P,) int array
        Indices of the joints; those without a gain stay at 0.
    gain : (S, P) array
        Each joint's motion per motor's.
    inverse : (P, S) array
        Its right inverse.
    """

    names: tuple[str, ...]
    lower: Array
    upper: Array
    speed: Array
    unit: Array
    joints: NDArray[np.int64]
    gain: Array
    inverse: Array

    def __len__(self) -> int:
        return len(self.names)

    @property
    def slides(self) -> NDArray[np.bool_]:
        """Whether a motor's joints slide, (S,)."""
        return np.asarray(self.unit != 1.0)

    def put(self, joints: Array, values: Array) -> None:
        """Put pre-shapes (B, S) into joints (B, J) [rad or m], in place."""
        joints[:, self.joints] = np.asarray(values, dtype=float) @ self.gain

    def of(self, joints: Array) -> Array:
        """Pre-shapes (B, S) of joints (B, J): by least squares where the joints disagree."""
        return np.asarray(joints[:, self.joints] @ self.inverse)

    def agree(self, joints: Array, tolerance: float) -> NDArray[np.bool_]:
        """Whether the joints (B, J) follow the motors, (B,)."""
        off = np.abs(joints[:, self.joints] - self.of(joints) @ self.gain)
        return np.asarray(2.0 * off.max(axis=1, initial=0.0) <= tolerance)

    def at(self, share: float) -> Array:
        """The pre-shape (S,) at a share of each motor's way."""
        return np.asarray(self.lower + share * (self.upper - self.lower))


def read_preshape(
    entries: Sequence[Mapping[str, Any]],
    joint_names: Sequence[str],
    joint_slides: NDArray[np.bool_],
    closing: Sequence[int],
) -> Preshape:
    """The pre-shape from its part of the YAML file.

    Parameters
    ----------
    entries : sequence of mappings
        One for each motor.
    joint_names, joint_slides
        Of the URDF.
    closing : sequence of int
        Joints that closing moves; the others are the pre-shape's.

    Raises
    ------
    RequestError
        If a joint is unknown or closes, or if the joints do not tell the motors apart.
    """
    joints = [j for j in range(len(joint_names)) if j not in closing]
    gain = np.zeros((len(entries), len(joints)))
    slides_of: list[bool] = []
    for number, entry in enumerate(entries):
        slides = set()
        for name, value in entry["joints"].items():
            if name not in joint_names:
                raise RequestError(
                    f"The pre-shape's motor '{entry['name']}' names a joint '{name}' that the URDF "
                    f"does not have; it has {', '.join(joint_names)}."
                )
            joint = list(joint_names).index(name)
            if joint in closing:
                raise RequestError(
                    f"Joint '{name}' is moved by the pre-shape's motor '{entry['name']}' and by "
                    "a finger's closing; leave it to one of them."
                )
            gain[number, joints.index(joint)] = float(value)
            slides.add(bool(joint_slides[joint]))
        if len(slides) > 1:
            raise RequestError(
                f"The pre-shape's motor '{entry['name']}' moves joints that turn and joints that "
                "slide; give each kind a motor of its own."
            )
        slides_of.append(True in slides)
    if np.linalg.matrix_rank(gain) < len(entries):
        raise RequestError(
            "The joints do not tell the pre-shape's motors apart: their gains are "
            f"{gain.tolist()}. Give each motor a joint with a gain, and no two motors the same."
        )
    lower, upper = (
        np.array([_end(*of, which) for of in zip(entries, slides_of, strict=True)])
        for which in ("lower", "upper")
    )
    travel_s = np.array([float(entry["full_travel_s"]) for entry in entries])
    if not (lower < upper).all() or not (travel_s > 0.0).all():
        raise RequestError(
            f"The pre-shape's motors go from {lower.tolist()} to {upper.tolist()} in "
            f"{travel_s.tolist()} s; give each a range and a time above 0."
        )
    return Preshape(
        names=tuple(str(entry["name"]) for entry in entries),
        lower=lower,
        upper=upper,
        speed=(upper - lower) / travel_s,
        unit=np.where(slides_of, SLIDING_LEVER_M, 1.0),
        joints=np.array(joints, dtype=np.int64),
        gain=gain,
        inverse=gain.T @ np.linalg.inv(gain @ gain.T),
    )


def _end(entry: Mapping[str, Any], slides: bool, which: str) -> float:
    """Lower or upper end of a motor [rad or m]; the lower is 0 where nothing is said."""
    if f"{which}{'_deg' if slides else '_mm'}" in entry:
        given, wanted = ("degrees", "mm") if slides else ("mm", "degrees")
        raise RequestError(
            f"The pre-shape's motor '{entry['name']}' has its {which} end in {given}, but its "
            f"joints {'slide' if slides else 'turn'}: give {wanted}."
        )
    if f"{which}_mm" in entry:
        return float(entry[f"{which}_mm"]) / 1000.0
    if which == "lower" and "lower_deg" not in entry:
        return 0.0
    return float(np.radians(float(entry[f"{which}_deg"])))
