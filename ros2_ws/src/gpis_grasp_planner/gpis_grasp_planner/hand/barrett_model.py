"""Write the BarrettHand BH8-280 model: URDF and link meshes, from its dimensions and masses.

``python -m gpis_grasp_planner.hand.barrett_model`` writes ``models/barrett_bh280/`` anew; the
files are kept in the package, so this runs only when a dimension changes.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.hand.barrett_shapes import (
    DISTAL_ANGLE_DEG,
    DISTAL_AXIS_MM,
    INNER_AXIS_MM,
    SPREAD_AXIS_OFFSET_MM,
    SPREAD_FRAME_HEIGHT_MM,
    barrett_pieces,
)
from gpis_grasp_planner.hand.link_mesh import write_stl
from gpis_grasp_planner.hand.model_elements import (
    Inertial,
    add_joint,
    add_link,
    add_materials,
    directory_argument,
    number_text,
    uniform_inertial,
    write_urdf,
)

Array = NDArray[np.float64]

MODEL_NAME = "barrett_bh280"
PALM_MASS_KG, PALM_CENTER_M = 0.609, np.array([0.0, 0.0045, 0.0373])  # F3's block included
PALM_INERTIA = np.diag([6.99e-4, 5.04e-4, 6.23e-4])  # about that centre [kg m^2]
KNUCKLE_MASS_KG, INNER_MASS_KG, DISTAL_MASS_KG = 0.141, 0.062, 0.041

FULL_CLOSE_S, FULL_SPREAD_S = 1.0, 0.5
TIP_FORCE_N = 15.0
# The torque at an axis that gives the active tip force at the tip's lever arm (joints at zero).
DISTAL_EFFORT, INNER_EFFORT, SPREAD_EFFORT = (TIP_FORCE_N * arm for arm in (0.0509, 0.1106, 0.1521))

INNER_UPPER_DEG, DISTAL_UPPER_DEG, SPREAD_UPPER_DEG = 140.0, 48.0, 180.0
BREAKAWAY_RATIO = 4.0 / 3.0  # distal joint's speed over the motor's after breakaway


def _about(inertial: Inertial, point: Array) -> Array:
    """Inertia of a body about another point (parallel axes)."""
    d = inertial.center - point
    return inertial.inertia + inertial.mass * (d @ d * np.eye(3) - np.outer(d, d))


def split_palm(block_pieces: tuple[tuple[str, TriangleMesh], ...]) -> tuple[Inertial, Inertial]:
    """Share the palm's measured mass, centre and inertia between palm body and F3's block.

    The centre lies 4.5 mm towards F3; the block gets the mass that explains this with the rest
    of the palm on its own axis. Together both give the measured figures exactly.

    Returns
    -------
    palm, block : Inertial
        In the palm's frame and in the block's own frame.
    """
    unit = uniform_inertial(1.0, block_pieces)
    along = float(unit.center[0])
    mass = PALM_MASS_KG * PALM_CENTER_M[1] / along
    block = Inertial(mass, unit.center, mass * unit.inertia)
    R = _rotation_z(90.0)
    center_p = R @ unit.center + (0.0, 0.0, SPREAD_FRAME_HEIGHT_MM / 1000.0)
    block_p = Inertial(mass, center_p, R @ block.inertia @ R.T)
    rest_mass = PALM_MASS_KG - mass
    rest_center = (PALM_MASS_KG * PALM_CENTER_M - mass * center_p) / rest_mass
    rest = Inertial(rest_mass, rest_center, np.zeros((3, 3)))
    about_center = PALM_INERTIA - _about(block_p, PALM_CENTER_M) - _about(rest, PALM_CENTER_M)
    return Inertial(rest_mass, rest_center, about_center), block


def _rotation_z(angle_deg: float) -> Array:
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def build_urdf() -> ET.Element:
    """The URDF as an element tree; mesh names are relative to the URDF's folder."""
    pieces = barrett_pieces()
    palm, block = split_palm(pieces["block"])
    robot = ET.Element("robot", name=MODEL_NAME)
    add_materials(robot)
    add_link(robot, "bh_palm_link", palm, pieces["palm"], "palm")
    knuckle = uniform_inertial(KNUCKLE_MASS_KG, pieces["knuckle"])
    for finger in (1, 2):
        add_link(robot, f"bh_finger_{finger}_knuckle_link", knuckle, pieces["knuckle"], "finger")
    add_link(robot, "bh_finger_3_knuckle_link", block, pieces["block"], "palm")
    for part, mass in (("inner", INNER_MASS_KG), ("distal", DISTAL_MASS_KG)):
        inertial = uniform_inertial(mass, pieces[part])
        for finger in (1, 2, 3):
            add_link(robot, f"bh_finger_{finger}_{part}_link", inertial, pieces[part], "finger")
    _joints(robot)
    ET.indent(robot)
    return robot


def _joints(robot: ET.Element) -> None:
    height = SPREAD_FRAME_HEIGHT_MM / 1000.0
    offset = SPREAD_AXIS_OFFSET_MM / 1000.0
    half_turn = np.pi / 2
    inner_speed = np.radians(INNER_UPPER_DEG) / FULL_CLOSE_S
    spread_limit = (np.radians(SPREAD_UPPER_DEG), np.pi / FULL_SPREAD_S, SPREAD_EFFORT)
    inner_limit = (np.radians(INNER_UPPER_DEG), inner_speed, INNER_EFFORT)
    distal_limit = (np.radians(DISTAL_UPPER_DEG), BREAKAWAY_RATIO * inner_speed, DISTAL_EFFORT)
    for finger, sign in ((1, -1.0), (2, 1.0)):
        joint = add_joint(
            robot,
            f"bh_j{finger}1_joint",
            ("bh_palm_link", f"bh_finger_{finger}_knuckle_link"),
            ((sign * offset, 0.0, height), (0.0, 0.0, -half_turn)),
            (0.0, 0.0, sign),
            spread_limit,
        )
        if finger == 2:
            ET.SubElement(joint, "mimic", joint="bh_j11_joint", multiplier="1")
    add_joint(
        robot,
        "bh_finger_3_knuckle_joint",
        ("bh_palm_link", "bh_finger_3_knuckle_link"),
        ((0.0, 0.0, height), (0.0, 0.0, half_turn)),
    )
    for finger in (1, 2, 3):
        add_joint(
            robot,
            f"bh_j{finger}2_joint",
            (f"bh_finger_{finger}_knuckle_link", f"bh_finger_{finger}_inner_link"),
            ((INNER_AXIS_MM[0] / 1000.0, 0.0, INNER_AXIS_MM[1] / 1000.0), (half_turn, 0.0, 0.0)),
            (0.0, 0.0, 1.0),
            inner_limit,
        )
    for finger in (1, 2, 3):
        joint = add_joint(
            robot,
            f"bh_j{finger}3_joint",
            (f"bh_finger_{finger}_inner_link", f"bh_finger_{finger}_distal_link"),
            (
                (DISTAL_AXIS_MM[0] / 1000.0, DISTAL_AXIS_MM[1] / 1000.0, 0.0),
                (0.0, 0.0, np.radians(DISTAL_ANGLE_DEG)),
            ),
            (0.0, 0.0, 1.0),
            distal_limit,
        )
        # Holds before breakaway only; see hand.drive.
        ET.SubElement(
            joint, "mimic", joint=f"bh_j{finger}2_joint", multiplier=number_text((1.0 / 3.0,))
        )


def write_model(directory: Path) -> None:
    """Write ``<name>.urdf`` and ``meshes/*.stl`` below `directory`."""
    meshes = directory / "meshes"
    meshes.mkdir(parents=True, exist_ok=True)
    for pieces in barrett_pieces().values():
        for name, mesh in pieces:
            write_stl(mesh, meshes / f"{name}.stl")
    write_urdf(build_urdf(), directory / f"{MODEL_NAME}.urdf")


if __name__ == "__main__":
    default = Path(__file__).parent / "models" / MODEL_NAME
    write_model(directory_argument(__doc__, default))
