"""Write the three-finger adaptive gripper: URDF and link meshes, from its dimensions.

``python build_model.py [DIRECTORY]`` writes beside itself; the files are kept in the package, so
this runs only when a dimension changes. All numbers are this project's own, of the size of common
adaptive grippers. Frames of links: x along the finger, y out of its pad, z along the joint.
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

NAME = "three_finger_adaptive"
HALF_WIDTH_MM = 12.0
PROXIMAL_MM, MIDDLE_MM = 58.0, 40.0  # from joint to joint
OUTWARDS_DEG = 25.0  # an open finger leans out of the palm's axis
BACK_DEG = 12.0  # an unbent distal link leans back, so that pads are parallel a little closed
KNUCKLE_HEIGHT_MM, KNUCKLE_AXIS_MM = 90.0, 10.0
# Where fingers stand on the palm [mm] and where they point to [deg about its z axis].
FINGERS = {"thumb": (0.0, 40.0, 90.0), "left": (-34.0, -40.0, -90.0), "right": (34.0, -40.0, -90.0)}
SPREAD_SIGN = {"left": -1.0, "right": 1.0}
SPREAD_DEG = 30.0
# Of each link: upper limit [deg], effort [N m], mass [kg].
LINKS = {
    "proximal": (75.0, 4.0, 0.07),
    "middle": (90.0, 2.5, 0.05),
    "distal": (55.0, 1.5, 0.03),
}
PALM_KG, KNUCKLE_KG = 1.5, 0.08
SPEED_RAD_S, SPREAD_SPEED_RAD_S, SPREAD_EFFORT_NM = 1.1, 1.0, 3.0


def shapes() -> dict[str, Pieces]:
    """Convex pieces [m] of each body."""
    proximal = np.vstack(
        [
            arc((0.0, 0.0), 12.5, 90.0, 270.0, 9),
            arc((PROXIMAL_MM, 0.0), 10.5, -90.0, 90.0, 9),
            crown((30.0, 13.0), 220.0, 8.0, 52.0, 7),
        ]
    )
    middle = np.vstack(
        [
            arc((0.0, 0.0), 10.5, 90.0, 270.0, 9),
            arc((MIDDLE_MM, 0.0), 9.5, -90.0, 90.0, 9),
            crown((20.0, 11.5), 160.0, 6.0, 34.0, 7),
        ]
    )
    distal = np.vstack(
        [
            arc((0.0, 0.0), 9.0, 90.0, 270.0, 9),
            crown((18.0, 10.0), 90.0, 8.0, 28.0, 7),
            arc((28.0, 1.0), 8.4, 80.0, -90.0, 9),
        ]
    )
    boxes = {
        "palm": {
            "palm_base": ((-50, -50, 0), (50, 50, 40)),
            "palm_body": ((-38, -24, 40), (38, 24, 90)),
        },
        "knuckle": {"knuckle": ((-12, -13, -50), (22, 13, 8))},
    }
    outlines = {"proximal": proximal, "middle": middle, "distal": distal}
    return pieces_of(boxes, outlines, HALF_WIDTH_MM)


def build_urdf(pieces: dict[str, Pieces]) -> ET.Element:
    """The URDF as an element tree; mesh names are relative to its folder."""
    robot = ET.Element("robot", name=NAME)
    add_materials(robot)
    palm = uniform_inertial(PALM_KG, pieces["palm"])
    add_link(robot, "palm_link", palm, pieces["palm"], "palm")
    knuckle = uniform_inertial(KNUCKLE_KG, pieces["knuckle"])
    for finger in FINGERS:
        add_link(robot, f"{finger}_knuckle_link", knuckle, pieces["knuckle"], "palm")
        add_finger_links(robot, finger, LINKS, pieces)
    for finger, (x, y, azimuth) in FINGERS.items():
        at = ((x / 1000.0, y / 1000.0, KNUCKLE_HEIGHT_MM / 1000.0), (0.0, 0.0, np.radians(azimuth)))
        links = ("palm_link", f"{finger}_knuckle_link")
        if finger in SPREAD_SIGN:
            limit = (np.radians(SPREAD_DEG), SPREAD_SPEED_RAD_S, SPREAD_EFFORT_NM)
            axis = (0.0, 0.0, SPREAD_SIGN[finger])
            spread = add_joint(robot, f"{finger}_spread_joint", links, at, axis, limit)
            if finger != "left":
                ET.SubElement(spread, "mimic", joint="left_spread_joint", multiplier="1")
        else:
            add_joint(robot, f"{finger}_knuckle_joint", links, at)
        _finger_joints(robot, finger)
    ET.indent(robot)
    return robot


def _finger_joints(robot: ET.Element, finger: str) -> None:
    # the finger's plane stands up on the knuckle's x axis
    stand = Rotation.from_euler("x", 90.0, degrees=True)
    lean = Rotation.from_euler("z", 90.0 - OUTWARDS_DEG, degrees=True)
    roll, pitch, yaw = (stand * lean).as_euler("xyz").tolist()
    origins = {
        "proximal": ("knuckle", KNUCKLE_AXIS_MM, (roll, pitch, yaw)),
        "middle": ("proximal", PROXIMAL_MM, (0.0, 0.0, 0.0)),
        "distal": ("middle", MIDDLE_MM, (0.0, 0.0, -np.radians(BACK_DEG))),
    }
    add_finger_joints(robot, finger, LINKS, origins, SPEED_RAD_S)


def write_model(directory: Path) -> None:
    """Write ``<name>.urdf`` and ``meshes/*.stl`` below `directory`."""
    pieces = shapes()
    model_elements.write_model(directory, NAME, build_urdf(pieces), pieces)


if __name__ == "__main__":
    write_model(model_elements.directory_argument(__doc__, Path(__file__).parent))
