"""Write the four-finger hand: URDF and link meshes, from its dimensions.

``python build_model.py [DIRECTORY]`` writes beside itself; the files are kept in the package, so
this runs only when a dimension changes. All numbers are this project's own, of the size of common
hands with four fingers of four joints. The fingers are alike; frames of their links: x along the
finger, y out of its pad, z along the joint.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.hand import model_elements
from gpis_grasp_planner.hand.model_elements import (
    Pieces,
    add_finger_joints,
    add_finger_links,
    add_joint,
    add_link,
    add_materials,
    pieces_of,
    uniform_inertial,
)
from gpis_grasp_planner.hand.outlines import arc, crown

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
    outlines = {"proximal": proximal, "middle": middle, "distal": distal}
    return pieces_of(boxes, outlines, HALF_WIDTH_MM)


def build_urdf(pieces: dict[str, Pieces]) -> ET.Element:
    """The URDF as an element tree; mesh names are relative to its folder."""
    robot = ET.Element("robot", name=NAME)
    add_materials(robot)
    palm = uniform_inertial(PALM_KG, pieces["palm"])
    add_link(robot, "palm_link", palm, pieces["palm"], "palm")
    base = uniform_inertial(BASE_KG, pieces["base"])
    for finger in FINGERS:
        add_link(robot, f"{finger}_base_link", base, pieces["base"], "palm")
        add_finger_links(robot, finger, LINKS, pieces)
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
    roll, pitch, yaw = (stand * rise).as_euler("xyz").tolist()
    origins = {
        "proximal": ("base", FLEXION_AXIS_MM, (roll, pitch, yaw)),
        "middle": ("proximal", PROXIMAL_MM, (0.0, 0.0, 0.0)),
        "distal": ("middle", MIDDLE_MM, (0.0, 0.0, 0.0)),
    }
    add_finger_joints(robot, finger, LINKS, origins, SPEED_RAD_S)


def write_model(directory: Path) -> None:
    """Write ``<name>.urdf`` and ``meshes/*.stl`` below `directory`."""
    pieces = shapes()
    model_elements.write_model(directory, NAME, build_urdf(pieces), pieces)


if __name__ == "__main__":
    write_model(model_elements.directory_argument(__doc__, Path(__file__).parent))
