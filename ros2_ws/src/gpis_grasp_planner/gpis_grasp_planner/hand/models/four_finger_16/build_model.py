"""Write the four-finger hand: URDF and link meshes, from its dimensions.

``python build_model.py [DIRECTORY]`` writes beside itself; the files are kept in the package, so
this runs only when a dimension changes. All numbers are this project's own, of the size of common
hands with four fingers of four joints. The fingers are alike; frames of their links: x along the
finger, y out of its pad, z along the joint.
"""

from __future__ import annotations

import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.hand.link_mesh import convex_hull, write_stl
from gpis_grasp_planner.hand.model_elements import (
    add_joint,
    add_link,
    add_materials,
    uniform_inertial,
    write_urdf,
)
from gpis_grasp_planner.hand.outlines import arc, bar, crown

NAME = "four_finger_16"
HALF_WIDTH_MM = 10.0
PROXIMAL_MM, MIDDLE_MM = 52.0, 36.0  # from joint to joint
RISE_DEG = 25.0  # an open finger stands this far up from the palm's face
BASE_HEIGHT_MM, FLEXION_AXIS_MM = 34.0, 15.0
# Where fingers stand on the palm [mm] and where they point to [deg about its z axis].
FINGERS = {
    "index": (42.0, -38.0, 0.0),
    "middle": (42.0, 0.0, 0.0),
    "ring": (42.0, 38.0, 0.0),
    "thumb": (-34.0, 0.0, 180.0),
}
# Of each joint: upper limit [deg], effort [N m], mass of its link [kg].
BASE_DEG, BASE_EFFORT_NM, BASE_KG = 50.0, 3.0, 0.05
LINKS = {
    "proximal": (95.0, 3.2, 0.06),
    "middle": (85.5, 2.4, 0.04),
    "distal": (76.0, 1.6, 0.03),
}
PALM_KG, SPEED_RAD_S = 0.9, 3.0

Pieces = tuple[tuple[str, TriangleMesh], ...]


def shapes() -> dict[str, Pieces]:
    """Convex pieces [m] of each body."""
    proximal = np.vstack(
        [
            arc((0.0, 0.0), 10.5, 90.0, 270.0, 9),
            arc((PROXIMAL_MM, 0.0), 9.5, -90.0, 90.0, 9),
            crown((26.0, 11.0), 200.0, 6.0, 46.0, 7),
        ]
    )
    middle = np.vstack(
        [
            arc((0.0, 0.0), 9.5, 90.0, 270.0, 9),
            arc((MIDDLE_MM, 0.0), 9.0, -90.0, 90.0, 9),
            crown((18.0, 10.5), 140.0, 6.0, 30.0, 7),
        ]
    )
    distal = np.vstack(
        [
            arc((0.0, 0.0), 8.8, 90.0, 270.0, 9),
            crown((15.0, 10.0), 70.0, 6.0, 24.0, 7),
            arc((25.0, 0.0), 9.2, 80.0, -90.0, 9),
        ]
    )
    boxes = {
        "palm": {"palm_plate": ((-40, -50, 0), (48, 50, 40))},
        "base": {"finger_base": ((-8, -11, -22), (24, 11, 8))},
    }
    points = {
        body: {
            name: np.array(
                [[x, y, z] for x in (a[0], b[0]) for y in (a[1], b[1]) for z in (a[2], b[2])]
            )
            for name, (a, b) in pieces.items()
        }
        for body, pieces in boxes.items()
    }
    for name, outline in (("proximal", proximal), ("middle", middle), ("distal", distal)):
        points[name] = {f"{name}_link": bar(outline, HALF_WIDTH_MM, 1.5)}
    return {
        body: tuple((name, convex_hull(p / 1000.0)) for name, p in pieces.items())
        for body, pieces in points.items()
    }


def build_urdf() -> ET.Element:
    """The URDF as an element tree; mesh names are relative to its folder."""
    pieces = shapes()
    robot = ET.Element("robot", name=NAME)
    add_materials(robot)
    palm = uniform_inertial(PALM_KG, pieces["palm"])
    add_link(robot, "palm_link", palm, pieces["palm"], "palm")
    base = uniform_inertial(BASE_KG, pieces["base"])
    for finger in FINGERS:
        add_link(robot, f"{finger}_base_link", base, pieces["base"], "palm")
        for link, (_, _, mass) in LINKS.items():
            body = uniform_inertial(mass, pieces[link])
            add_link(robot, f"{finger}_{link}_link", body, pieces[link], "finger")
    for finger, (x, y, azimuth) in FINGERS.items():
        joint = add_joint(
            robot,
            f"{finger}_base_joint",
            ("palm_link", f"{finger}_base_link"),
            ((x / 1000.0, y / 1000.0, BASE_HEIGHT_MM / 1000.0), (0.0, 0.0, np.radians(azimuth))),
            (0.0, 0.0, 1.0),
            (np.radians(BASE_DEG), SPEED_RAD_S, BASE_EFFORT_NM),
        )
        limit = joint.find("limit")
        if limit is not None:  # it turns to both sides
            limit.set("lower", f"-{limit.get('upper')}")
        _finger_joints(robot, finger)
    ET.indent(robot)
    return robot


def _finger_joints(robot: ET.Element, finger: str) -> None:
    # the finger's plane stands up on the base's x axis
    stand = Rotation.from_euler("x", 90.0, degrees=True)
    rise = Rotation.from_euler("z", RISE_DEG, degrees=True)
    first = tuple(float(v) for v in (stand * rise).as_euler("xyz"))
    origins = {
        "proximal": ("base", FLEXION_AXIS_MM, first),
        "middle": ("proximal", PROXIMAL_MM, (0.0, 0.0, 0.0)),
        "distal": ("middle", MIDDLE_MM, (0.0, 0.0, 0.0)),
    }
    for link, (parent, along, turn) in origins.items():
        upper, effort, _ = LINKS[link]
        add_joint(
            robot,
            f"{finger}_{link}_joint",
            (f"{finger}_{parent}_link", f"{finger}_{link}_link"),
            ((along / 1000.0, 0.0, 0.0), (turn[0], turn[1], turn[2])),
            (0.0, 0.0, 1.0),
            (np.radians(upper), SPEED_RAD_S, effort),
        )


def write_model(directory: Path) -> None:
    """Write ``<name>.urdf`` and ``meshes/*.stl`` below `directory`."""
    meshes = directory / "meshes"
    meshes.mkdir(parents=True, exist_ok=True)
    for pieces in shapes().values():
        for name, mesh in pieces:
            write_stl(mesh, meshes / f"{name}.stl")
    write_urdf(build_urdf(), directory / f"{NAME}.urdf")


if __name__ == "__main__":
    write_model(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
