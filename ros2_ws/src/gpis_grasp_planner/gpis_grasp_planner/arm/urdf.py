"""Read the chain of an arm from a URDF: revolute joints, and bodies of simple shapes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.transforms import rotation_from_rpy, transform

Array = NDArray[np.float64]

_TURNING = ("revolute", "continuous")
_TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class Body:
    """A collision shape of a link.

    Attributes
    ----------
    link : int
        0 for what stands with the base, i for what turns with joint i (from 1).
    shape : str
        "cylinder", "sphere" or "box".
    size : tuple of float [m]
        Radius and length, radius, or three edges.
    T_link_shape : (4, 4) array
    """

    link: int
    shape: str
    size: tuple[float, ...]
    T_link_shape: Array

    @property
    def radius(self) -> float:
        """Of the ball about the shape's middle that holds it [m]."""
        if self.shape == "sphere":
            return self.size[0]
        if self.shape == "cylinder":
            return float(np.hypot(self.size[0], 0.5 * self.size[1]))
        return 0.5 * float(np.linalg.norm(self.size))


@dataclass(frozen=True, eq=False)
class ArmChain:
    """n revolute joints from the base to the flange.

    Attributes
    ----------
    joint_names : tuple of str, n entries
    link_names : tuple of str, n + 1 entries
        The first is the base.
    T_parent_joint : (n, 4, 4) array
        Pose of joint i's frame in the frame of the joint before it, at angle zero.
    joint_axis : (n, 3) array
        Unit axes in the joints' own frames.
    joint_lower, joint_upper : (n,) arrays [rad]
        A continuous joint has one turn each way.
    T_last_flange : (4, 4) array
    bodies : tuple of Body
    """

    joint_names: tuple[str, ...]
    link_names: tuple[str, ...]
    T_parent_joint: Array
    joint_axis: Array
    joint_lower: Array
    joint_upper: Array
    T_last_flange: Array
    bodies: tuple[Body, ...]


def read_chain(path: Path, flange_link: str) -> ArmChain:
    """Read the chain that ends in a link.

    Raises
    ------
    RequestError
        If the file cannot be read, lacks the link, or has joints and shapes that are not known.
    """
    try:
        robot = ET.parse(path).getroot()
    except (OSError, ET.ParseError) as error:
        raise RequestError(f"Cannot read the arm's URDF '{path}': {error}.") from error
    links = {str(link.get("name")): link for link in robot.findall("link")}
    if flange_link not in links:
        raise RequestError(f"'{path}' has no link '{flange_link}'; it has {', '.join(links)}.")
    above = {_of(joint, "child", "link"): joint for joint in robot.findall("joint")}
    way: list[ET.Element] = []
    link = flange_link
    while link in above and above[link] not in way:
        way.insert(0, above[link])
        link = _of(way[0], "parent", "link")
    names, T_parent, axes, limits = [], [], [], []
    members: list[list[tuple[str, Array]]] = [[(link, np.eye(4))]]
    T = np.eye(4)  # of the link that the walk is at, in the last joint's frame
    for joint in way:
        T = T @ _origin(joint)
        kind, name = joint.get("type"), str(joint.get("name"))
        if kind in _TURNING:
            names.append(name)
            T_parent.append(T)
            axes.append(_axis(joint))
            limits.append(_limit(joint, path))
            members.append([])
            T = np.eye(4)
        elif kind != "fixed":
            raise RequestError(
                f"Joint '{name}' of '{path}' is '{kind}'; an arm has revolute and fixed joints."
            )
        members[-1].append((_of(joint, "child", "link"), T))
    if not names:
        raise RequestError(f"No joint of '{path}' turns before '{flange_link}'.")
    bodies = [
        body
        for number, group in enumerate(members)
        for member, T_link in group
        for body in _bodies(links[member], number, T_link, path)
    ]
    return ArmChain(
        tuple(names),
        tuple(group[0][0] for group in members),
        np.array(T_parent),
        np.array(axes),
        np.array(limits)[:, 0],
        np.array(limits)[:, 1],
        T,
        tuple(bodies),
    )


def _bodies(link: ET.Element, number: int, T_link: Array, path: Path) -> list[Body]:
    found = []
    for element in link.findall("collision"):
        T = T_link @ _origin(element)
        [shape] = list(element.find("geometry") or [ET.Element("nothing")])
        size: tuple[float, ...]
        if shape.tag == "cylinder":
            size = (float(shape.get("radius", "nan")), float(shape.get("length", "nan")))
        elif shape.tag == "sphere":
            size = (float(shape.get("radius", "nan")),)
        elif shape.tag == "box":
            size = tuple(_numbers(shape.get("size", "nan")))
        else:
            raise RequestError(
                f"Link '{link.get('name')}' of '{path}' has a collision shape '{shape.tag}'; "
                "describe an arm by cylinders, spheres and boxes about its links."
            )
        if not (np.isfinite(size).all() and min(size) > 0.0):
            raise RequestError(
                f"A {shape.tag} of link '{link.get('name')}' of '{path}' has the size {size}; "
                "sizes are positive, in metres."
            )
        found.append(Body(number, shape.tag, size, T))
    return found


def _limit(joint: ET.Element, path: Path) -> tuple[float, float]:
    if joint.get("type") == "continuous":
        return -_TURN, _TURN
    limit = joint.find("limit")
    lower, upper = (
        float("nan" if limit is None else limit.get(key, "nan")) for key in ("lower", "upper")
    )
    if not lower < upper:
        raise RequestError(
            f"Joint '{joint.get('name')}' of '{path}' has the limits {lower} and {upper} rad; give "
            "a lower and an upper one."
        )
    return lower, upper


def _axis(joint: ET.Element) -> Array:
    element = joint.find("axis")
    axis = _numbers("1 0 0" if element is None else element.get("xyz", "1 0 0"))
    return np.asarray(axis / np.linalg.norm(axis))


def _origin(element: ET.Element) -> Array:
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    rpy, xyz = _numbers(origin.get("rpy", "0 0 0")), _numbers(origin.get("xyz", "0 0 0"))
    return transform(rotation_from_rpy(rpy), xyz)


def _of(joint: ET.Element, tag: str, key: str) -> str:
    element = joint.find(tag)
    return "" if element is None else str(element.get(key))


def _numbers(text: str) -> Array:
    return np.array([float(word) for word in text.split()])
