"""Elements of a hand's URDF: pieces of its links, materials, masses, joints, and the files."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.hand.link_mesh import (
    convex_hull,
    inertia_from_moments,
    solid_properties,
    write_stl,
)
from gpis_grasp_planner.hand.outlines import bar

Array = NDArray[np.float64]
Pieces = tuple[tuple[str, TriangleMesh], ...]
Corner = tuple[float, float, float]
Link = tuple[float, float, float]

_CHAMFER_MM = 1.5

COLORS = {"palm": (0.20, 0.21, 0.23), "finger": (0.42, 0.44, 0.47)}


@dataclass(frozen=True)
class Inertial:
    """Mass [kg], centre of mass (3,) [m] and inertia (3, 3) about it [kg m^2]."""

    mass: float
    center: Array
    inertia: Array


def pieces_of(
    boxes: Mapping[str, Mapping[str, tuple[Corner, Corner]]],
    outlines: Mapping[str, Array],
    half_width_mm: float,
) -> dict[str, Pieces]:
    """Convex pieces [m] of bodies made of boxes and of links that are extruded outlines.

    Parameters
    ----------
    boxes : mapping
        Two opposite corners [mm] of each piece of each body.
    outlines : mapping of str to (n, 2) arrays [mm]
        Of links in their plane; the piece of ``proximal`` is ``proximal_link``.
    half_width_mm : float
    """
    points = {
        body: {
            name: np.array([*product(*zip(*corners, strict=True))]) for name, corners in of.items()
        }
        for body, of in boxes.items()
    }
    for name, outline in outlines.items():
        points[name] = {f"{name}_link": bar(outline, half_width_mm, _CHAMFER_MM)}
    return {
        body: tuple((name, convex_hull(p / 1000.0)) for name, p in pieces.items())
        for body, pieces in points.items()
    }


def uniform_inertial(mass: float, pieces: Pieces) -> Inertial:
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
    pieces: Pieces,
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


def add_finger_links(
    robot: ET.Element, finger: str, links: Mapping[str, Link], pieces: Mapping[str, Pieces]
) -> None:
    """The links of one finger; of each in `links` the last figure is its mass [kg]."""
    for link, (_, _, mass) in links.items():
        body = uniform_inertial(mass, pieces[link])
        add_link(robot, f"{finger}_{link}_link", body, pieces[link], "finger")


def add_finger_joints(
    robot: ET.Element,
    finger: str,
    links: Mapping[str, Link],
    origins: Mapping[str, tuple[str, float, tuple[float, float, float]]],
    speed_rad_s: float,
) -> None:
    """The joints of one finger, which turn about z.

    Of each of its `links` the upper limit [deg] and the effort [N m]; `origins` are its parent, how
    far along the parent's x the joint lies [mm], and its rpy [rad].
    """
    for link, (parent, along, turn) in origins.items():
        upper, effort, _ = links[link]
        add_joint(
            robot,
            f"{finger}_{link}_joint",
            (f"{finger}_{parent}_link", f"{finger}_{link}_link"),
            ((along / 1000.0, 0.0, 0.0), turn),
            (0.0, 0.0, 1.0),
            (np.radians(upper), speed_rad_s, effort),
        )


def number_text(values: tuple[float, ...] | Array) -> str:
    """Numbers as they stand in a URDF."""
    # 12 digits keep right angles right to 1e-12; adding 0.0 turns -0 into 0.
    return " ".join(f"{round(float(v), 15) + 0.0:.12g}" for v in values)


def directory_argument(description: str, default: Path) -> Path:
    """Where a script that writes a model does so, by its command line."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("directory", type=Path, nargs="?", default=default)
    directory: Path = parser.parse_args().directory
    return directory


def write_model(
    directory: Path, name: str, robot: ET.Element, pieces: Mapping[str, Pieces]
) -> None:
    """Write ``<name>.urdf`` and ``meshes/*.stl`` below a directory."""
    meshes = directory / "meshes"
    meshes.mkdir(parents=True, exist_ok=True)
    for of_body in pieces.values():
        for piece, mesh in of_body:
            write_stl(mesh, meshes / f"{piece}.stl")
    write_urdf(robot, directory / f"{name}.urdf")


def write_urdf(robot: ET.Element, path: Path) -> None:
    """Write an element tree."""
    with path.open("wb") as file:
        ET.ElementTree(robot).write(file, encoding="utf-8", xml_declaration=True)
        file.write(b"\n")
