"""The default support and obstacles as texts of parameters."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.surroundings.obstacles import read_pose
from gpis_grasp_planner.surroundings.text import parse_scene


@lru_cache(maxsize=8)
def support_pose_of(text: str) -> NDArray[np.float64]:
    """Pose (4, 4) from seven numbers ``x y z qx qy qz qw``.

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
            f"Setting 'support_pose' is {text!r}; it takes seven numbers: x y z [m] and "
            "the quaternion x y z w, such as '0 0 0.75 0 0 0 1'.",
            ErrorCode.INVALID_SCENE,
        )
    entry = {"position": numbers[:3], "quat_xyzw": numbers[3:]}
    return read_pose(entry, "the setting support_pose")


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
