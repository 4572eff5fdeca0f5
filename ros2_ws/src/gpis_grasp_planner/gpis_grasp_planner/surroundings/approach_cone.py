"""Directions from which the hand may come: a cone about an axis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.surroundings.obstacles import check_keys, read_vector

Array = NDArray[np.float64]

FRAMES = ("world", "object")


@dataclass(frozen=True, eq=False)
class ApproachCone:
    """The palm's z, along which the hand approaches, lies within an angle of an axis.

    Attributes
    ----------
    axis : (3,) array
        The direction of motion towards the part: 0 0 -1 comes from above. Made a unit vector.
    half_angle_deg : float [deg]
        0 to 180.
    frame : str
        "world", the frame of the part's pose, or "object", the part's own.
    """

    axis: Array
    half_angle_deg: float
    frame: str = "world"

    def __post_init__(self) -> None:
        axis = read_vector(self.axis, "axis of the approach")
        length = float(np.linalg.norm(axis))
        if length < 1e-9:
            raise _invalid(
                f"The axis of the approach has length {length:g}. Give the direction in which "
                "the hand moves towards the part, such as 0 0 -1 from above."
            )
        object.__setattr__(self, "axis", axis / length)
        angle = float(self.half_angle_deg)
        if not 0.0 <= angle <= 180.0:
            raise _invalid(
                f"The half angle of the approach is {angle:g} degrees; allowed are 0 to 180. "
                "Ask again with an angle in that range."
            )
        object.__setattr__(self, "half_angle_deg", angle)
        if self.frame not in FRAMES:
            raise _invalid(
                f"The frame of the approach is '{self.frame}'; choose one of {', '.join(FRAMES)}."
            )

    def axis_in_object(self, T_world_object: Array) -> Array:
        """The axis (3,) in the part's frame."""
        if self.frame == "object":
            return self.axis
        return np.asarray(np.asarray(T_world_object)[:3, :3].T @ self.axis)

    def as_mapping(self) -> dict[str, Any]:
        """The JSON form, from which :meth:`from_mapping` makes the same cone."""
        return {
            "axis": self.axis.tolist(),
            "half_angle_deg": self.half_angle_deg,
            "frame": self.frame,
        }

    @staticmethod
    def from_mapping(data: Mapping[str, Any]) -> ApproachCone:
        """Build from ``{"axis": [3], "half_angle_deg": float, "frame": "world" | "object"}``.

        Raises
        ------
        RequestError
            INVALID_SCENE.
        """
        check_keys(data, {"axis", "half_angle_deg", "frame"}, "the approach")
        try:
            angle = float(data.get("half_angle_deg", np.nan))
        except (TypeError, ValueError):
            angle = np.nan
        return ApproachCone(data.get("axis", ()), angle, str(data.get("frame", "world")))


def _invalid(message: str) -> RequestError:
    return RequestError(message, ErrorCode.INVALID_SCENE)
