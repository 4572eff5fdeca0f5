"""Elements of a hand's URDF: materials, links with their masses, joints, and the file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.hand.link_mesh import inertia_from_moments, solid_properties

Array = NDArray[np.float64]

COLORS = {"palm": (0.20, 0.21, 0.23), "finger": (0.42, 0.44, 0.47)}


@dataclass(frozen=True)
class Inertial:
    """Mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it [kg m^2]."""

    mass: float
    center: Array
    inertia: Array


def uniform_inertial(mass: float, pieces: tuple[tuple[str, TriangleMesh], ...]) -> Inertial:
    """Inertial of a body of one density made of convex pieces (overlaps count twice)."""
    properties = [solid_properties(mesh) for _, mesh in pieces]
    volume = sum(v for v, _, _ in properties)
    center = np.sum([v * c for v, c, _ in properties], axis=0) / volume
    moments = mass / volume * np.sum([m for _, _, m in properties], axis=0)
    return Inertial(mass, center, inertia_from_moments(moments - mass * np.outer(center, center)))


def add_materials(robot: ET.Element) -> None:
    """The colours of palm and fingers."""
    for name, rgb in COLORS.items():
        material = ET.SubElement(robot, "material", name=name)
        ET.SubElement(material, "color", rgba=number_text((*rgb, 1.0)))


def add_link(
    robot: ET.Element,
    name: str,
    body: Inertial,
    pieces: tuple[tuple[str, TriangleMesh], ...],
    material: str,
) -> None:
    """A link whose pieces are both seen and felt; their files are ``meshes/<piece>.stl``."""
    link = ET.SubElement(robot, "link", name=name)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=number_text(body.center), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=number_text((body.mass,)))
    entries = {
        f"i{'xyz'[i]}{'xyz'[j]}": number_text((body.inertia[i, j],))
        for i in range(3)
        for j in range(i, 3)
    }
    ET.SubElement(inertial, "inertia", entries)
    for role in ("visual", "collision"):
        for piece, _ in pieces:
            shape = ET.SubElement(link, role, name=f"{piece}_{role}")
            geometry = ET.SubElement(shape, "geometry")
            ET.SubElement(geometry, "mesh", filename=f"meshes/{piece}.stl")
            if role == "visual":
                ET.SubElement(shape, "material", name=material)


def add_joint(
    robot: ET.Element,
    name: str,
    links: tuple[str, str],
    origin: tuple[tuple[float, float, float], tuple[float, float, float]],
    axis: tuple[float, float, float] | None = None,
    limit: tuple[float, float, float] | None = None,
) -> ET.Element:
    """A joint between a parent and a child link; fixed without an axis.

    `origin` is xyz [m] and rpy [rad], `limit` the upper limit [rad], velocity [rad/s] and effort
    [N m]; joints begin at 0.
    """
    kind = "fixed" if axis is None else "revolute"
    joint = ET.SubElement(robot, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=links[0])
    ET.SubElement(joint, "child", link=links[1])
    ET.SubElement(joint, "origin", xyz=number_text(origin[0]), rpy=number_text(origin[1]))
    if axis is not None and limit is not None:
        upper, velocity, effort = (number_text((value,)) for value in limit)
        ET.SubElement(joint, "axis", xyz=number_text(axis))
        ET.SubElement(joint, "limit", lower="0", upper=upper, velocity=velocity, effort=effort)
    return joint


def number_text(values: tuple[float, ...] | Array) -> str:
    """Numbers as they stand in a URDF."""
    # 12 digits keep right angles right to 1e-12; adding 0.0 turns -0 into 0.
    return " ".join(f"{round(float(v), 15) + 0.0:.12g}" for v in values)


def write_urdf(robot: ET.Element, path: Path) -> None:
    """Write an element tree."""
    with path.open("wb") as file:
        ET.ElementTree(robot).write(file, encoding="utf-8", xml_declaration=True)
        file.write(b"\n")
