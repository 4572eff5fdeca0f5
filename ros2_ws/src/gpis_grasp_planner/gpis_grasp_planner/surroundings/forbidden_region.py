"""Regions of the part that must stay untouched: threads, sealing faces, labels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.transforms import inverse, to_position_quat_xyzw
from gpis_grasp_planner.surroundings.obstacles import BoxObstacle, check_keys, read_pose

Array = NDArray[np.float64]

DEFAULT_MARGIN_M = 0.002
_LARGEST_MARGIN_M = 0.1
_MOST_REGIONS = 50


@dataclass(frozen=True, eq=False)
class ForbiddenRegion:
    """A box in the part's frame that no contact lies in and no link comes near.

    Attributes
    ----------
    pose : (4, 4) array
        Of the box's middle, T_object_box.
    size : (3,) array [m]
    name : str
    margin_m : float [m]
        How far the hand's links keep from the box on the whole way, 0 to 0.1.
    """

    pose: Array
    size: Array
    name: str = "region"
    margin_m: float = DEFAULT_MARGIN_M

    def __post_init__(self) -> None:
        box = BoxObstacle(self.pose, self.size, self.name)
        object.__setattr__(self, "pose", box.pose)
        object.__setattr__(self, "size", box.size)
        margin = float(self.margin_m)
        if not 0.0 <= margin <= _LARGEST_MARGIN_M:
            raise RequestError(
                f"The margin of '{self.name}' is {margin:g} m; allowed are 0 to "
                f"{_LARGEST_MARGIN_M:g} m. Ask again with a margin in that range.",
                ErrorCode.INVALID_SCENE,
            )
        object.__setattr__(self, "margin_m", margin)

    @property
    def box(self) -> BoxObstacle:
        """The box as a body."""
        return BoxObstacle(self.pose, self.size, self.name)

    def contains(self, points: Array) -> NDArray[np.bool_]:
        """Which points (..., 3) in the part's frame lie in the box or on it (...)."""
        T = inverse(self.pose)
        local = np.asarray(points) @ T[:3, :3].T + T[:3, 3]
        return np.asarray((np.abs(local) <= 0.5 * self.size + 1e-9).all(axis=-1))

    def as_mapping(self) -> dict[str, Any]:
        """The JSON form, from which :meth:`from_mapping` makes the same region."""
        position, quat_xyzw = to_position_quat_xyzw(self.pose)
        return {
            "name": self.name,
            "position": position.tolist(),
            "quat_xyzw": quat_xyzw.tolist(),
            "size": self.size.tolist(),
            "margin_m": self.margin_m,
        }

    @staticmethod
    def from_mapping(data: Mapping[str, Any], name: str = "region") -> ForbiddenRegion:
        """Build from fields of the names above, with "position" and "quat_xyzw" for the pose.

        Only the size must be given.

        Raises
        ------
        RequestError
            INVALID_SCENE.
        """
        check_keys(data, {"name", "position", "quat_xyzw", "size", "margin_m"}, f"'{name}'")
        name = str(data.get("name", name))
        try:
            margin = float(data.get("margin_m", DEFAULT_MARGIN_M))
        except (TypeError, ValueError):
            margin = np.nan
        return ForbiddenRegion(read_pose(data, f"'{name}'"), data.get("size", ()), name, margin)


def read_regions(entries: Any) -> tuple[ForbiddenRegion, ...]:
    """Regions of a list in the JSON form.

    Raises
    ------
    RequestError
        INVALID_SCENE, also for more than 50.
    """
    if not isinstance(entries, (list, tuple)):
        raise RequestError(
            f"'forbidden' is a {type(entries).__name__}; give a list.", ErrorCode.INVALID_SCENE
        )
    if len(entries) > _MOST_REGIONS:
        raise RequestError(
            f"There are {len(entries)} forbidden regions; at most {_MOST_REGIONS} are taken. Join "
            "them into fewer boxes.",
            ErrorCode.INVALID_SCENE,
        )
    return tuple(
        ForbiddenRegion.from_mapping(entry, f"forbidden region {k}")
        for k, entry in enumerate(entries)
    )
