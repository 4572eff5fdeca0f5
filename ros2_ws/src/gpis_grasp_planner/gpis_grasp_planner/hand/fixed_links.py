"""Links of a URDF that are fixed to others: one body with what carries them.

Fingertips, pads, sensors and tool frames are links of their own in many URDFs. The planner knows
links that joints move, each a body. What is fixed to such a link goes with it: its shapes and its
mass are put into its carrier, and its name stays as a frame. So are links without a collision shape
wherever they are, and what is fixed to a carrier without one. A link with shapes that is fixed to
the palm stays a link, which may have the palm's friction or the fingers'.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.hand.urdf_origin import move_origin, origin_of

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FixedFrame:
    """A link that went into its carrier, as a frame.

    Attributes
    ----------
    name : str
        Of the link in the URDF.
    carrier : str
        The link that it is one body with.
    T_carrier_frame : (4, 4) array
        Where it stands in the carrier's frame.
    """

    name: str
    carrier: str
    T_carrier_frame: Array


def fold_fixed_links(robot: ET.Element) -> tuple[FixedFrame, ...]:
    """Put fixed links into what carries them, in place; return the frames that they were.

    Inertia tensors are not summed: the trials take them from the shapes.
    """
    frames: list[FixedFrame] = []
    links = {str(link.get("name")): link for link in robot.findall("link")}
    while (joint := _next_to_fold(robot, links)) is not None:
        child, carrier = _end(joint, "child"), _end(joint, "parent")
        T_carrier_child = origin_of(joint)
        _put(links[child], links[carrier], T_carrier_child)
        for other in robot.findall("joint"):
            if _end(other, "parent") == child:
                move_origin(other, T_carrier_child)
                other.find("parent").set("link", carrier)  # type: ignore[union-attr]
        frames = [
            replace(
                frame,
                carrier=carrier,
                T_carrier_frame=T_carrier_child @ frame.T_carrier_frame,
            )
            if frame.carrier == child
            else frame
            for frame in frames
        ]
        frames.append(FixedFrame(child, carrier, T_carrier_child))
        robot.remove(joint)
        robot.remove(links.pop(child))
    return tuple(frames)


def _next_to_fold(robot: ET.Element, links: dict[str, ET.Element]) -> ET.Element | None:
    above = {_end(joint, "child"): joint for joint in robot.findall("joint")}
    for child, joint in above.items():
        carrier = _end(joint, "parent")
        if joint.get("type") != "fixed" or not {child, carrier} <= links.keys():
            continue
        solid = all(links[name].find("collision") is not None for name in (child, carrier))
        if not solid or _is_moved(carrier, above):
            return joint
    return None


def _is_moved(link: str, above: dict[str, ET.Element]) -> bool:
    """Whether a joint that is not fixed is on the way from a link to the root."""
    seen = set[str]()  # a ring of links is told of later
    while link in above and link not in seen:
        seen.add(link)
        if above[link].get("type") != "fixed":
            return True
        link = _end(above[link], "parent")
    return False


def _put(link: ET.Element, carrier: ET.Element, T_carrier_link: Array) -> None:
    """Shapes and mass of a link into its carrier."""
    if link.find("visual") is not None or carrier.find("visual") is not None:
        for body in (link, carrier):  # who has no looks of its own is seen by its solid shapes
            if body.find("visual") is None:
                body.extend(_as_visual(shape) for shape in body.findall("collision"))
    for shape in [*link.findall("visual"), *link.findall("collision")]:
        move_origin(shape, T_carrier_link)
        carrier.append(shape)
    mass = _mass(link)
    if mass > 0.0:
        inertial = carrier.find("inertial")
        if inertial is None:
            inertial = ET.SubElement(carrier, "inertial")
        summed = _mass(carrier) + mass
        for old in inertial.findall("mass"):
            inertial.remove(old)
        ET.SubElement(inertial, "mass", value=repr(summed))


def _as_visual(collision: ET.Element) -> ET.Element:
    shape = deepcopy(collision)
    shape.tag = "visual"
    return shape


def _mass(link: ET.Element) -> float:
    found = link.find("inertial/mass")
    return 0.0 if found is None else float(found.get("value", 0))


def _end(joint: ET.Element, tag: str) -> str:
    """The link that a joint names as parent or child; "" where it names none (told of later)."""
    found = joint.find(tag)
    return "" if found is None else found.get("link", "")
