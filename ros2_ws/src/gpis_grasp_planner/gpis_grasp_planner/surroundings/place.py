"""Where a part lies, what stands around it there, and how well its pose is known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, PoseError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import to_position_quat_xyzw
from gpis_grasp_planner.surroundings.covariance import check_covariance
from gpis_grasp_planner.surroundings.obstacles import Surroundings, check_keys, read_pose

Array = NDArray[np.float64]

# For those who check a place and need not know the geometry of its meshes.
STAND_IN = TriangleMesh(1e-3 * np.eye(3), np.array([[0, 1, 2]], dtype=np.int32))


@dataclass(frozen=True, eq=False)
class Place:
    """One place of a part; true where there is anything that its grasps depend on.

    Attributes
    ----------
    T_world_object : (4, 4) array
        "World" is the frame of the surroundings.
    surroundings : Surroundings
        In the world's frame.
    covariance : (6, 6) array or None
        Of the pose, in the object's axes (`surroundings.covariance`); None where it is not known.
    T_world_arm : (4, 4) array or None
        The frame in which an arm's file gives its base; grasps then depend on the part's pose
        itself. None without an arm.
    """

    T_world_object: Array = field(default_factory=lambda: np.eye(4))
    surroundings: Surroundings = field(default_factory=Surroundings)
    covariance: Array | None = None
    T_world_arm: Array | None = None

    def __bool__(self) -> bool:
        given = self.covariance is not None or self.T_world_arm is not None
        return given or bool(self.surroundings)

    def around(self) -> Surroundings:
        """The surroundings in the object's frame."""
        return self.surroundings.seen_from(self.T_world_object)

    def as_mapping_if_stated(self) -> dict[str, Any] | None:
        """The JSON form; None for a part in free space at the world's own pose."""
        stated = bool(self) or not np.array_equal(self.T_world_object, np.eye(4))
        return self.as_mapping() if stated else None

    def as_mapping(self) -> dict[str, Any]:
        """The JSON form, from which :meth:`from_mapping` makes the same place."""
        position, quat_xyzw = to_position_quat_xyzw(self.T_world_object)
        data = {
            "object": {"position": position.tolist(), "quat_xyzw": quat_xyzw.tolist()},
            **self.surroundings.as_mapping(),
        }
        if self.covariance is not None:
            data["covariance"] = self.covariance.ravel().tolist()
        if self.T_world_arm is not None:
            position, quat_xyzw = to_position_quat_xyzw(self.T_world_arm)
            data["arm"] = {"position": position.tolist(), "quat_xyzw": quat_xyzw.tolist()}
        return data

    @staticmethod
    def from_mapping(
        data: Mapping[str, Any], load_mesh: Callable[[str], TriangleMesh] | None = None
    ) -> Place:
        """Build from the form of `Surroundings.from_mapping` with three more fields.

        "object" is the part's pose in the frame of all the others (``{"position": [3],
        "quat_xyzw": [4]}``; not given: the same frame), "covariance" as :func:`read_covariance`
        takes it, "arm" a pose like "object".

        Raises
        ------
        RequestError
            INVALID_SCENE.
        PoseError
            INVALID_COVARIANCE.
        """
        check_keys(data, {"support", "obstacles", "object", "covariance", "arm"}, "the place")
        pose = data.get("object", {})
        check_keys(pose, {"position", "quat_xyzw"}, "the object's pose")
        arm = data.get("arm")
        if arm is not None:
            check_keys(arm, {"position", "quat_xyzw"}, "the arm's pose")
        around = {k: v for k, v in data.items() if k in ("support", "obstacles")}
        covariance = data.get("covariance")
        return Place(
            read_pose(pose, "the object"),
            Surroundings.from_mapping(around, load_mesh),
            None if covariance is None else read_covariance(covariance),
            None if arm is None else read_pose(arm, "the arm"),
        )


def read_covariance(numbers: Any) -> Array:
    """Covariance (6, 6) from 36 numbers, row by row, or from the 6 of its diagonal.

    Raises
    ------
    PoseError
        INVALID_COVARIANCE.
    """
    try:
        values = np.array(numbers, dtype=float).ravel()
    except (TypeError, ValueError):
        values = np.empty(0)
    if values.size not in (6, 36):
        raise PoseError(
            f"The covariance of the pose has {values.size} numbers; give 36, or the 6 of its "
            "diagonal (x, y, z, rotation about x, y, z; m^2 and rad^2).",
            ErrorCode.INVALID_COVARIANCE,
        )
    return check_covariance(np.diag(values) if values.size == 6 else values.reshape(6, 6))
