"""Read the kinematic tree and the shapes of a URDF with the standard library.

Understands revolute, prismatic and fixed joints, joints that mimic others, and the shapes of
`hand.link_shapes`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.hand.fixed_links import FixedFrame, fold_fixed_links
from gpis_grasp_planner.hand.link_shapes import is_readable, link_shapes, mesh_path
from gpis_grasp_planner.hand.palm_turn import turn_root
from gpis_grasp_planner.hand.urdf_origin import numbers, origin_of

Array = NDArray[np.float64]

# Of a joint, with what URDF takes where nothing is said; the last two it asks for.
_LIMITS = {"lower": "0", "upper": "0", "velocity": "nan", "effort": "nan"}


@dataclass(frozen=True, eq=False)
class UrdfTree:
    """Links from the root outwards, and the movable joints in the order of the file.

    Attributes
    ----------
    link_names : tuple of str, L entries
    link_parent : (L,) int array
        Index of the parent link, -1 for the root; a parent always precedes its children.
    link_joint : (L,) int array
        Index of the joint that moves the link, -1 where it is fixed to its parent.
    T_parent_joint : (L, 4, 4) array
        Pose of the link in its parent at joint angle zero.
    joint_axis : (L, 3) array
        Unit axis in the link's frame; zero where fixed.
    joint_names : tuple of str, J entries
    joint_slides : (J,) bool array
        Whether the joint is prismatic: its position is in metres then, its effort in newtons.
    joint_mimic : tuple, J entries
        Of a joint that mimics another: the other's index, multiplier and offset; else None.
    joint_lower, joint_upper, joint_velocity, joint_effort : (J,) arrays [rad, rad/s, N m]
        Or [m, m/s, N] where the joint slides.
    link_mass : (L,) array [kg]
    link_collision : tuple of tuples of TriangleMesh
        Convex pieces per link, in the link's frame [m].
    fixed_frames : tuple of FixedFrame
        Links of the file that are one body with others (`hand.fixed_links`).
    """

    link_names: tuple[str, ...]
    link_parent: NDArray[np.int64]
    link_joint: NDArray[np.int64]
    T_parent_joint: Array
    joint_axis: Array
    joint_names: tuple[str, ...]
    joint_slides: NDArray[np.bool_]
    joint_mimic: tuple[tuple[int, float, float] | None, ...]
    joint_lower: Array
    joint_upper: Array
    joint_velocity: Array
    joint_effort: Array
    link_mass: Array
    link_collision: tuple[tuple[TriangleMesh, ...], ...]
    fixed_frames: tuple[FixedFrame, ...]


def read_urdf(path: Path, turn: Array | None = None, hulls: bool = False) -> UrdfTree:
    """Read a URDF file, its root turned by a rotation (3, 3) if one is given (`palm_turn`).

    With `hulls` the collision shapes are the convex hulls of the file's.

    Raises
    ------
    RequestError
        If the file is missing, is no XML, or its links do not form one tree.
    MeshError
        If a collision mesh is missing or damaged.
    """
    try:
        robot = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise RequestError(
            f"Cannot read the hand's URDF '{path}': {why}. Correct or reinstall it.",
            ErrorCode.INVALID_SETTING,
        ) from error
    if turn is not None:
        turn_root(robot, turn)
    fixed_frames = fold_fixed_links(robot)
    links = {link.get("name", ""): link for link in robot.findall("link")}
    joints = robot.findall("joint")
    joint_of_child = {_child(joint, "child"): joint for joint in joints}
    order = _from_root(list(links), joint_of_child, path)
    movable = [joint for joint in joints if joint.get("type") != "fixed"]
    for joint in movable:
        if joint.get("type") not in ("revolute", "prismatic"):
            raise RequestError(
                f"Joint '{joint.get('name')}' of '{path}' is '{joint.get('type')}'; hands may have "
                "revolute, prismatic and fixed joints."
            )
    joint_names = tuple(joint.get("name", "") for joint in movable)
    limits = np.array(
        [
            [float(_element(joint, "limit").get(key, default)) for joint in movable]
            for key, default in _LIMITS.items()
        ]
    )
    n_links = len(order)
    link_parent = np.full(n_links, -1)
    link_joint = np.full(n_links, -1)
    T_parent_joint = np.tile(np.eye(4), (n_links, 1, 1))
    joint_axis = np.zeros((n_links, 3))
    for index, name in enumerate(order):
        if name not in joint_of_child:
            continue
        moving = joint_of_child[name]
        link_parent[index] = order.index(_child(moving, "parent"))
        T_parent_joint[index] = origin_of(moving)
        if moving.get("name") in joint_names:
            link_joint[index] = joint_names.index(moving.get("name", ""))
            joint_axis[index] = _axis(moving)
    masses = [
        float(m.get("value", 0)) if (m := links[name].find("inertial/mass")) is not None else 0.0
        for name in order
    ]
    return UrdfTree(
        link_names=tuple(order),
        link_parent=link_parent,
        link_joint=link_joint,
        T_parent_joint=T_parent_joint,
        joint_axis=joint_axis,
        joint_names=joint_names,
        joint_slides=np.array([joint.get("type") == "prismatic" for joint in movable]),
        joint_mimic=tuple(_mimic(joint, joint_names) for joint in movable),
        joint_lower=limits[0],
        joint_upper=limits[1],
        joint_velocity=limits[2],
        joint_effort=limits[3],
        link_mass=np.array(masses),
        link_collision=link_shapes(path, [links[name] for name in order], "collision", hulls),
        fixed_frames=fixed_frames,
    )


def collision_meshes(path: Path) -> tuple[Path, ...]:
    """The meshes of a URDF's collision shapes, each once."""
    shapes = ET.parse(path).getroot().iter("collision")
    names = {str(mesh.get("filename")) for shape in shapes for mesh in shape.iter("mesh")}
    return tuple(mesh_path(path, name) for name in sorted(names))


def with_mesh_uris(path: Path, mesh_uri_prefix: str, turn: Array | None = None) -> str:
    """The URDF's text with `mesh_uri_prefix` put before mesh names that are no URIs themselves.

    Turned as in read_urdf.
    """
    robot = ET.parse(path).getroot()
    if turn is not None:
        turn_root(robot, turn)
    prefix = mesh_uri_prefix.rstrip("/")
    for mesh in robot.iter("mesh"):
        name = mesh.get("filename", "")
        if name.startswith("/"):
            mesh.set("filename", Path(name).as_uri())
        elif "://" not in name:
            mesh.set("filename", f"{prefix}/{quote(name)}")
    return ET.tostring(robot, encoding="unicode", xml_declaration=True)


def _from_root(names: list[str], joint_of_child: dict[str, ET.Element], path: Path) -> list[str]:
    """Links with parents before children, otherwise in the file's order."""
    order: list[str] = [name for name in names if name not in joint_of_child]
    if len(order) != 1:
        raise RequestError(f"'{path}' has {len(order)} root links {order}; a hand has one.")
    waiting = [name for name in names if name in joint_of_child]
    while waiting:
        ready = [name for name in waiting if _child(joint_of_child[name], "parent") in order]
        if not ready:
            raise RequestError(f"Links {waiting} of '{path}' do not hang on '{order[0]}'.")
        order += ready
        waiting = [name for name in waiting if name not in ready]
    return order


def visual_shapes(
    path: Path, tree: UrdfTree, turn: Array | None = None
) -> tuple[tuple[TriangleMesh, ...], ...]:
    """What the links of a tree look like, in their frames; the root's turned as in read_urdf.

    A link without visual shapes, or with one of a kind that is not known, has its collision shapes.

    Raises
    ------
    RequestError, MeshError
        For a mesh file that is not there or damaged.
    """
    robot = ET.parse(path).getroot()
    if turn is not None:
        turn_root(robot, turn)
    fold_fixed_links(robot)
    links = {str(link.get("name")): link for link in robot.iterfind("link")}
    bare = ET.Element("link")
    seen = [links[n] if is_readable(links[n]) else bare for n in tree.link_names]
    visual = link_shapes(path, seen, "visual")
    return tuple(v or solid for v, solid in zip(visual, tree.link_collision, strict=True))


def _axis(joint: ET.Element) -> Array:
    """Unit axis (3,); along x, as URDF says, where none is given."""
    found = joint.find("axis")
    axis = numbers("1 0 0" if found is None else found.get("xyz", "1 0 0"))
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        raise RequestError(
            f"Joint '{joint.get('name')}' of the hand's URDF has the axis {axis.tolist()}; give "
            "it a direction."
        )
    return np.asarray(axis / length)


def _element(parent: ET.Element, tag: str) -> ET.Element:
    found = parent.find(tag)
    if found is None:
        raise RequestError(f"Joint '{parent.get('name')}' of the hand's URDF has no <{tag}>.")
    return found


def _child(joint: ET.Element, tag: str) -> str:
    return _element(joint, tag).get("link", "")


def _mimic(joint: ET.Element, joint_names: tuple[str, ...]) -> tuple[int, float, float] | None:
    found = joint.find("mimic")
    if found is None:
        return None
    if found.get("joint") not in joint_names:
        raise RequestError(
            f"Joint '{joint.get('name')}' of the hand's URDF mimics '{found.get('joint')}', which "
            f"is none of its movable joints: {', '.join(joint_names)}."
        )
    index = joint_names.index(found.get("joint", ""))
    return index, float(found.get("multiplier", 1.0)), float(found.get("offset", 0.0))
