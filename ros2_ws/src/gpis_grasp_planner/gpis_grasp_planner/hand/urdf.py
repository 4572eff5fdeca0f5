"""Read the kinematic tree and the collision pieces of a URDF with the standard library.

Understands what the hands of this project use: revolute, prismatic and fixed joints, collision
shapes that are boxes or convex STL pieces in metres with names relative to the URDF's folder.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.transforms import apply, rotation_from_rpy, transform
from gpis_grasp_planner.hand.link_mesh import read_stl
from gpis_grasp_planner.hand.palm_turn import turn_root

Array = NDArray[np.float64]


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
    joint_lower, joint_upper, joint_velocity, joint_effort : (J,) arrays [rad, rad/s, N m]
        Or [m, m/s, N] where the joint slides.
    link_mass : (L,) array [kg]
    link_collision : tuple of tuples of TriangleMesh
        Convex pieces per link, in the link's frame [m].
    """

    link_names: tuple[str, ...]
    link_parent: NDArray[np.int64]
    link_joint: NDArray[np.int64]
    T_parent_joint: Array
    joint_axis: Array
    joint_names: tuple[str, ...]
    joint_slides: NDArray[np.bool_]
    joint_lower: Array
    joint_upper: Array
    joint_velocity: Array
    joint_effort: Array
    link_mass: Array
    link_collision: tuple[tuple[TriangleMesh, ...], ...]


def read_urdf(path: Path, turn: Array | None = None) -> UrdfTree:
    """Read a URDF file, its root turned by a rotation (3, 3) if one is given (`palm_turn`).

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
        raise RequestError(
            f"Cannot read the hand's URDF '{path}': {error}. Correct or reinstall it.",
            ErrorCode.INVALID_SETTING,
        ) from error
    if turn is not None:
        turn_root(robot, turn)
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
            [float(_element(joint, "limit").get(key, "nan")) for joint in movable]
            for key in ("lower", "upper", "velocity", "effort")
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
        T_parent_joint[index] = _origin(moving)
        if moving.get("name") in joint_names:
            link_joint[index] = joint_names.index(moving.get("name", ""))
            axis = _numbers(_element(moving, "axis").get("xyz", "1 0 0"))
            joint_axis[index] = axis / np.linalg.norm(axis)
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
        joint_lower=limits[0],
        joint_upper=limits[1],
        joint_velocity=limits[2],
        joint_effort=limits[3],
        link_mass=np.array(masses),
        link_collision=_shapes(path, [links[name] for name in order], "collision"),
    )


def mesh_files(path: Path) -> tuple[Path, ...]:
    """The meshes that a URDF names, each once."""
    names = {str(mesh.get("filename")) for mesh in ET.parse(path).getroot().iter("mesh")}
    return tuple(path.parent / name for name in sorted(names))


def with_mesh_uris(path: Path, mesh_uri_prefix: str, turn: Array | None = None) -> str:
    """The URDF's text with `mesh_uri_prefix` put before every mesh name, turned as in read_urdf."""
    robot = ET.parse(path).getroot()
    if turn is not None:
        turn_root(robot, turn)
    prefix = mesh_uri_prefix.rstrip("/")
    for mesh in robot.iter("mesh"):
        mesh.set("filename", f"{prefix}/{mesh.get('filename')}")
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
    path: Path, link_names: tuple[str, ...], turn: Array | None = None
) -> tuple[tuple[TriangleMesh, ...], ...]:
    """What the links look like, in the links' frames; the root's turned as in read_urdf.

    A link without visual shapes, or with one that is neither a box nor an STL file, has its
    collision shapes.

    Raises
    ------
    RequestError, MeshError
        For an STL file that is not there or none.
    """
    robot = ET.parse(path).getroot()
    if turn is not None:
        turn_root(robot, turn)
    links = {str(link.get("name")): link for link in robot.iterfind("link")}
    chosen = [links[name] for name in link_names]
    bare = ET.Element("link")
    seen_links = [link if _is_readable(link) else bare for link in chosen]
    visual, collision = _shapes(path, seen_links, "visual"), _shapes(path, chosen, "collision")
    return tuple(seen or solid for seen, solid in zip(visual, collision, strict=True))


def _is_readable(link: ET.Element) -> bool:
    """Whether all visual shapes are boxes or STL files."""
    for shape in link.findall("visual"):
        mesh = shape.find("geometry/mesh")
        if mesh is None and shape.find("geometry/box") is None:
            return False
        if mesh is not None and not mesh.get("filename", "").lower().endswith(".stl"):
            return False
    return True


def _shapes(path: Path, links: list[ET.Element], kind: str) -> tuple[tuple[TriangleMesh, ...], ...]:
    files: dict[str, TriangleMesh] = {}
    result = []
    for link in links:
        pieces = []
        for shape in link.findall(kind):
            mesh, box = shape.find("geometry/mesh"), shape.find("geometry/box")
            if mesh is not None:
                name = mesh.get("filename", "")
                if name not in files:
                    files[name] = read_stl(path.parent / name)
            elif box is not None:
                name = f"box {box.get('size')}"
                files.setdefault(name, _box(_numbers(box.get("size", "0 0 0"))))
            else:
                raise RequestError(
                    f"Link '{link.get('name')}' of '{path}' has a {kind} shape that is neither "
                    "a box nor a mesh; give boxes or convex STL pieces."
                )
            piece, T_link_piece = files[name], _origin(shape)
            if not np.array_equal(T_link_piece, np.eye(4)):
                piece = TriangleMesh(apply(T_link_piece, piece.vertices), piece.faces)
            pieces.append(piece)
        result.append(tuple(pieces))
    return tuple(result)


def _box(size: Array) -> TriangleMesh:
    """A box (3,) [m] about the origin."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    # counter-clockwise seen from outside; corner 4 i + 2 j + k
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [(a, b, c) for a, b, c, _ in sides] + [(a, c, d) for a, _, c, d in sides]
    return TriangleMesh(corners * size, np.array(faces, dtype=np.int32))


def _origin(element: ET.Element) -> Array:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    R = rotation_from_rpy(_numbers(origin.get("rpy", "0 0 0")))
    return transform(R, _numbers(origin.get("xyz", "0 0 0")))


def _element(parent: ET.Element, tag: str) -> ET.Element:
    found = parent.find(tag)
    if found is None:
        raise RequestError(f"Joint '{parent.get('name')}' of the hand's URDF has no <{tag}>.")
    return found


def _child(joint: ET.Element, tag: str) -> str:
    return _element(joint, tag).get("link", "")


def _numbers(text: str) -> Array:
    return np.array([float(word) for word in text.split()])
