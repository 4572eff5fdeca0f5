"""The default support and obstacles as texts of parameters."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.surroundings.obstacles import read_pose
from gpis_grasp_planner.surroundings.text import parse_scene

FARTHEST_M = 1e6


@lru_cache(maxsize=8)
def pose_of_text(text: str, name: str) -> NDArray[np.float64]:
    """Pose (4, 4) from seven numbers ``x y z qx qy qz qw``; not to be written to.

    Parameters
    ----------
    text : str
    name : str
        Of the setting.

    Raises
    ------
    RequestError
        INVALID_SCENE.
    """
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != 7:
        raise RequestError(
            f"Setting '{name}' is {text!r:.80}; it takes seven numbers: x y z [m] and the "
            "quaternion x y z w, such as '0 0 0.75 0 0 0 1'.",
            ErrorCode.INVALID_SCENE,
        )
    T = read_pose({"quat_xyzw": numbers[3:]}, f"the setting {name}")
    T[:3, 3] = read_far_position(numbers[:3], f"the setting {name}")
    T.flags.writeable = False
    return T


def point_of_text(text: str, name: str) -> tuple[float, float, float]:
    """Point from three numbers ``x y z`` [m]. Raises RequestError (INVALID_SETTING)."""
    try:
        x, y, z = (float(word) for word in text.split())
        if np.isfinite([x, y, z]).all():
            return x, y, z
    except ValueError:
        pass
    raise RequestError(
        f"Setting '{name}' is {text!r:.80}; it takes three numbers x y z [m], such as '0.5 0 0.8'."
    )


def read_far_position(value: Any, what: str) -> NDArray[np.float64]:
    """Position (3,) in a frame that may be a map's: up to 1000 km.

    Raises
    ------
    RequestError
        INVALID_SCENE.
    """
    try:
        position = np.array(value, dtype=float)
    except (TypeError, ValueError):
        position = np.empty(0)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise RequestError(
            f"The position of {what} is {value!r:.80}; give 3 finite numbers.",
            ErrorCode.INVALID_SCENE,
        )
    if np.abs(position).max() > FARTHEST_M:
        raise RequestError(
            f"The position of {what} is {position.tolist()} m; the limit is {FARTHEST_M:g} m. "
            "Give metres.",
            ErrorCode.INVALID_SCENE,
        )
    return position


def near_origin(entry: Any, origin: NDArray[np.float64] | None = None) -> Any:
    """An obstacle's entry with its position counted from `origin`, or (0, 0, 0) without one."""
    if not isinstance(entry, Mapping):
        return entry
    what = f"'{entry.get('name', 'an obstacle')!s:.60}'"
    position = read_far_position(entry.get("position", (0.0, 0.0, 0.0)), what)
    shifted = np.zeros(3) if origin is None else position - origin
    return {**entry, "position": shifted.tolist()}


@lru_cache(maxsize=8)
def obstacles_of(text: str) -> list[dict[str, Any]]:
    """List of obstacles from YAML or JSON, in the form of ``docs/clearance.md``; "" is empty.

    Raises
    ------
    RequestError
        INVALID_SCENE, where it is no list; what is in the list is not looked at.
    """
    listed = parse_scene(text, "The setting 'obstacles'") or []
    if not isinstance(listed, list):
        raise RequestError(
            f"Setting 'obstacles' is {text!r:.80}; it takes a list as YAML or JSON, such as "
            "'[{name: wall, position: [0.4, 0, 0.9], size: [0.02, 1, 0.3]}]'.",
            ErrorCode.INVALID_SCENE,
        )
    return listed
