"""What stands around the part: the surface that carries it, boxes and meshes.

Given in the world's frame, or in any other: `Surroundings.moved` takes them to the part's. An
obstacle is kept in its own frame with a pose, so that what is made of a mesh is made once.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import (
    from_position_quat_xyzw,
    inverse,
    to_position_quat_xyzw,
)

if TYPE_CHECKING:
    from gpis_grasp_planner.geometry.triangle_tree import TriangleTree

Array = NDArray[np.float64]

_LARGEST_M = 100.0
_MOST_OBSTACLES = 200
_CORNERS = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))


@dataclass(frozen=True, eq=False)
class SupportPlane:
    """The plane on which the part rests; everything behind it is solid.

    Attributes
    ----------
    point : (3,) array [m]
        Any point of the plane.
    normal : (3,) array
        Away from the support, towards the part; made a unit vector.
    name : str
    """

    point: Array
    normal: Array
    name: str = "support"

    def __post_init__(self) -> None:
        object.__setattr__(self, "point", read_vector(self.point, f"point of '{self.name}'"))
        normal = read_vector(self.normal, f"normal of '{self.name}'")
        length = float(np.linalg.norm(normal))
        if length < 1e-9:
            raise _invalid(
                f"The normal of '{self.name}' has length {length:g}. Give the direction that "
                "points away from the support, such as 0 0 1."
            )
        object.__setattr__(self, "normal", normal / length)

    def moved(self, T_new_old: Array) -> SupportPlane:
        """The same plane in another frame."""
        R, t = T_new_old[:3, :3], T_new_old[:3, 3]
        return SupportPlane(R @ self.point + t, R @ self.normal, self.name)


@dataclass(frozen=True, eq=False)
class BoxObstacle:
    """A solid box: the pose (4, 4) of its middle and its edge lengths (3,) [m]."""

    pose: Array
    size: Array
    name: str = "box"

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", _pose(self.pose, self.name))
        size = read_vector(self.size, f"size of '{self.name}'")
        if size.min() < 0.0:
            raise _invalid(f"The size of '{self.name}' is {size} m; edge lengths are not negative.")
        object.__setattr__(self, "size", size)

    @property
    def corners(self) -> Array:
        """Corners (8, 3) in the box's own frame."""
        return _CORNERS * self.size


@dataclass(frozen=True, eq=False)
class MeshObstacle:
    """A triangle mesh at a pose (4, 4); solid where it is closed.

    `source` is what the mesh was loaded by: a catalogue ID or a file.
    """

    pose: Array
    mesh: TriangleMesh
    name: str = "mesh"
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", _pose(self.pose, self.name))
        if not len(self.mesh.faces) or not np.isfinite(self.mesh.vertices).all():
            raise _invalid(
                f"The mesh of '{self.name}' has {len(self.mesh.faces)} faces or vertices that are "
                "not finite. Give a mesh with at least one face."
            )

    @cached_property
    def tree(self) -> TriangleTree:
        """Tree over the mesh's triangles, in its own frame; 5 ms per 1000 triangles, once."""
        # Not at the top: the node declares surroundings without loading compiled code.
        from gpis_grasp_planner.geometry.triangle_tree import TriangleTree

        return TriangleTree.of(self.mesh)


Obstacle = BoxObstacle | MeshObstacle


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A support plane, if there is one, and obstacles, all in one frame."""

    support: SupportPlane | None = None
    obstacles: tuple[Obstacle, ...] = field(default=())

    def __post_init__(self) -> None:
        if len(self.obstacles) > _MOST_OBSTACLES:
            raise _invalid(
                f"There are {len(self.obstacles)} obstacles; at most {_MOST_OBSTACLES} are taken. "
                "Join them into fewer boxes or one mesh."
            )

    def __bool__(self) -> bool:
        return self.support is not None or bool(self.obstacles)

    def as_mapping(self) -> dict[str, Any]:
        """The JSON form, from which :meth:`from_mapping` makes the same surroundings."""
        data: dict[str, Any] = {}
        if (plane := self.support) is not None:
            data["support"] = {
                "name": plane.name,
                "point": plane.point.tolist(),
                "normal": plane.normal.tolist(),
            }
        if self.obstacles:
            data["obstacles"] = [_entry(obstacle) for obstacle in self.obstacles]
        return data

    def moved(self, T_new_old: ArrayLike) -> Surroundings:
        """The same surroundings in another frame."""
        T = np.asarray(T_new_old, dtype=float)
        return Surroundings(
            None if self.support is None else self.support.moved(T),
            tuple(self._moved(obstacle, T) for obstacle in self.obstacles),
        )

    def seen_from(self, T_world_object: ArrayLike) -> Surroundings:
        """The same surroundings in the frame of a part whose pose in theirs is given (4, 4)."""
        return self.moved(inverse(T_world_object))

    @staticmethod
    def _moved(obstacle: Obstacle, T_new_old: Array) -> Obstacle:
        moved = replace(obstacle, pose=T_new_old @ obstacle.pose)
        if isinstance(obstacle, MeshObstacle):
            moved.__dict__["tree"] = obstacle.tree  # what the cached property has made
        return moved

    @staticmethod
    def from_mapping(
        data: Mapping[str, Any], load_mesh: Callable[[str], TriangleMesh] | None = None
    ) -> Surroundings:
        """Build from the JSON form (see ``docs/clearance.md``).

        ``{"support": {"point": [3], "normal": [3]}, "obstacles": [{"name": str,
        "position": [3], "quat_xyzw": [4], "size": [3]} or {..., "mesh": str}]}``

        Parameters
        ----------
        data : mapping
        load_mesh : callable, optional
            Makes a mesh [m] of what an obstacle's "mesh" says.

        Raises
        ------
        RequestError
            INVALID_SCENE, for what is missing, unknown or not a number.
        """
        check_keys(data, {"support", "obstacles"}, "the surroundings")
        support = None
        if (plane := data.get("support")) is not None:
            check_keys(plane, {"point", "normal", "name"}, "the support")
            support = SupportPlane(
                plane.get("point", np.zeros(3)),
                plane.get("normal", np.array([0.0, 0.0, 1.0])),
                str(plane.get("name", "support")),
            )
        listed = data.get("obstacles", ())
        if not isinstance(listed, (list, tuple)):
            raise _invalid(f"'obstacles' is a {type(listed).__name__}; give a list.")
        return Surroundings(
            support, tuple(_obstacle(entry, k, load_mesh) for k, entry in enumerate(listed))
        )


def _obstacle(
    entry: Mapping[str, Any], k: int, load_mesh: Callable[[str], TriangleMesh] | None
) -> Obstacle:
    check_keys(entry, {"name", "position", "quat_xyzw", "size", "mesh"}, f"obstacle {k}")
    name = str(entry.get("name", f"obstacle {k}"))
    if ("size" in entry) == ("mesh" in entry):
        raise _invalid(f"'{name}' must have either a 'size' (a box) or a 'mesh'.")
    pose = read_pose(entry, f"'{name}'")
    if "size" in entry:
        return BoxObstacle(pose, entry["size"], name)
    if load_mesh is None:
        raise _invalid(f"'{name}' is a mesh, and meshes are not taken here; give boxes.")
    source = str(entry["mesh"])
    return MeshObstacle(pose, load_mesh(source), name, source)


def _entry(obstacle: Obstacle) -> dict[str, Any]:
    position, quat_xyzw = to_position_quat_xyzw(obstacle.pose)
    entry = {
        "name": obstacle.name,
        "position": position.tolist(),
        "quat_xyzw": quat_xyzw.tolist(),
    }
    if isinstance(obstacle, BoxObstacle):
        return {**entry, "size": obstacle.size.tolist()}
    return {**entry, "mesh": obstacle.source}


def read_pose(entry: Mapping[str, Any], what: str) -> Array:
    """Pose (4, 4) of the fields "position" and "quat_xyzw"; what is not given is zero.

    Raises
    ------
    RequestError
        INVALID_SCENE, naming `what`.
    """
    quat = read_vector(entry.get("quat_xyzw", (0.0, 0.0, 0.0, 1.0)), f"quaternion of {what}", 4)
    norm = float(np.linalg.norm(quat))
    if abs(norm - 1.0) > 1e-3:
        raise _invalid(
            f"The quaternion of {what} has norm {norm:.4f}; it must be 1 (order x, y, z, w)."
        )
    position = read_vector(entry.get("position", np.zeros(3)), f"position of {what}")
    return from_position_quat_xyzw(position, quat / norm)


def check_keys(data: Any, known: set[str], what: str) -> None:
    """Refuse what is no mapping, or has other names than the known ones (INVALID_SCENE)."""
    if not isinstance(data, Mapping):
        raise _invalid(f"The description of {what} is a {type(data).__name__}; give an object.")
    if unknown := sorted(set(data) - known):
        raise _invalid(
            f"Unknown name {', '.join(map(repr, unknown))} in {what}; known are "
            f"{', '.join(sorted(known))}."
        )


def read_vector(value: Any, what: str, n: int = 3) -> Array:
    """Vector (n,) of finite figures up to 100 m.

    Raises
    ------
    RequestError
        INVALID_SCENE, naming `what`.
    """
    try:
        vector = np.array(value, dtype=float)
    except (TypeError, ValueError):
        vector = np.full(0, np.nan)
    if vector.shape != (n,) or not np.isfinite(vector).all():
        raise _invalid(f"The {what} is {value}; give {n} finite numbers.")
    if np.abs(vector).max() > _LARGEST_M:
        raise _invalid(
            f"The {what} is {value}; figures beyond {_LARGEST_M:g} m are not plausible. "
            "Give metres."
        )
    return vector


def _pose(value: Any, name: str) -> Array:
    pose = np.array(value, dtype=float)
    good = pose.shape == (4, 4) and bool(np.isfinite(pose).all())
    if not good or np.abs(pose[:3, :3] @ pose[:3, :3].T - np.eye(3)).max() > 1e-6:
        raise _invalid(f"The pose of '{name}' is no rigid transform (4, 4); correct it.")
    return pose


def _invalid(message: str) -> RequestError:
    return RequestError(message, ErrorCode.INVALID_SCENE)
