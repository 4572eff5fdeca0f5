"""Write the URDFs of the two arms from Denavit-Hartenberg parameters and a few cylinders.

The parameters are facts that the makers publish; the bodies are cylinders and spheres of about the
sizes of their data sheets, chosen here. Run as a program, it writes both beside itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

PI = float(np.pi)

# Row i (standard convention): T = Rot_z(q_i) Trans_z(d) Trans_x(a) Rot_x(alpha). [m, rad]
#             d       a        alpha
SIX_AXIS_DH = (
    (0.1625, 0.0, PI / 2),
    (0.0, -0.425, 0.0),
    (0.0, -0.3922, 0.0),
    (0.1333, 0.0, PI / 2),
    (0.0997, 0.0, -PI / 2),
    (0.0996, 0.0, 0.0),
)  # fmt: skip
SEVEN_AXIS_DH = (
    (0.34, 0.0, -PI / 2),
    (0.0, 0.0, PI / 2),
    (0.4, 0.0, PI / 2),
    (0.0, 0.0, -PI / 2),
    (0.4, 0.0, -PI / 2),
    (0.0, 0.0, PI / 2),
    (0.126, 0.0, 0.0),
)
SIX_AXIS_LIMITS = tuple(np.deg2rad((360, 360, 180, 360, 360, 360)))
SEVEN_AXIS_LIMITS = tuple(np.deg2rad((170, 120, 170, 120, 170, 120, 175)))

# Cylinders of link i between two points of joint i's frame, and spheres: both as (p, q, radius).
SIX_AXIS_BODIES = {
    0: (((0, 0, 0), (0, 0, 0.09), 0.075),),
    1: (((0, 0, 0.10), (0, 0, 0.225), 0.065),),
    2: (
        ((0, 0, 0.065), (0, 0, 0.20), 0.06),
        ((0, 0, 0.138), (-0.425, 0, 0.138), 0.055),
        ((-0.425, 0, 0.08), (-0.425, 0, 0.19), 0.055),
    ),
    3: (
        ((0, 0, -0.045), (0, 0, 0.07), 0.05),
        ((0, 0, 0.007), (-0.3922, 0, 0.007), 0.043),
        ((-0.3922, 0, -0.04), (-0.3922, 0, 0.07), 0.043),
    ),
    4: (((0, 0, -0.05), (0, 0, 0.05), 0.04),),
    5: (((0, 0, -0.05), (0, 0, 0.05), 0.04),),
    6: (((0, 0, 0.06), (0, 0, 0.0996), 0.04),),
}
SEVEN_AXIS_BODIES = {
    0: (((0, 0, 0), (0, 0, 0.14), 0.09),),
    1: (((0, 0, 0.15), (0, 0, 0.34), 0.08),),
    2: (((0, 0, 0), (0, 0, 0), 0.095),),
    3: (((0, 0, 0.10), (0, 0, 0.27), 0.065),),
    4: (((0, 0, 0), (0, 0, 0), 0.085),),
    5: (((0, 0, 0.15), (0, 0, 0.33), 0.06),),
    6: (((0, 0, 0), (0, 0, 0), 0.07),),
    7: (((0, 0, 0.07), (0, 0, 0.126), 0.045),),
}


def write_arm(
    path: Path,
    dh: tuple[tuple[float, float, float], ...],
    limits: tuple[float, ...],
    bodies: Mapping[int, Sequence[tuple[Sequence[float], Sequence[float], float]]],
) -> None:
    """Write the URDF of one arm: joint i turns about z of its frame, which row i - 1 places."""
    robot = ET.Element("robot", name=path.stem)
    names = ["base_link", *(f"link_{i}" for i in range(1, len(dh) + 1)), "flange"]
    for number, name in enumerate(names):
        link = ET.SubElement(robot, "link", name=name)
        for p, q, radius in bodies.get(number, ()) if name != "flange" else ():
            for role in ("visual", "collision"):
                _add_body(ET.SubElement(link, role), np.array(p), np.array(q), radius)
    before = (0.0, 0.0, 0.0)
    for number in range(len(dh) + 1):
        fixed = number == len(dh)
        joint = ET.SubElement(
            robot,
            "joint",
            name="flange_joint" if fixed else f"joint_{number + 1}",
            type="fixed" if fixed else "revolute",
        )
        ET.SubElement(joint, "parent", link=names[number])
        ET.SubElement(joint, "child", link=names[number + 1])
        d, a, alpha = before
        ET.SubElement(joint, "origin", xyz=_text((a, 0.0, d)), rpy=_text((alpha, 0.0, 0.0)))
        if not fixed:
            limit = _text((limits[number],))
            ET.SubElement(joint, "axis", xyz="0 0 1")
            ET.SubElement(
                joint, "limit", lower=f"-{limit}", upper=limit, velocity="3", effort="150"
            )
            before = dh[number]
    ET.indent(robot)
    path.write_text(ET.tostring(robot, encoding="unicode") + "\n", encoding="utf-8")


def _add_body(element: ET.Element, p: np.ndarray, q: np.ndarray, radius: float) -> None:
    along, middle = q - p, 0.5 * (p + q)
    length = float(np.linalg.norm(along))
    # URDF's cylinder lies along z; all bodies here lie along x or z
    rpy = (0.0, PI / 2, 0.0) if length and abs(along[0]) > 0.5 * length else (0.0, 0.0, 0.0)
    ET.SubElement(element, "origin", xyz=_text(middle), rpy=_text(rpy))
    geometry = ET.SubElement(element, "geometry")
    if length:
        ET.SubElement(geometry, "cylinder", radius=_text((radius,)), length=_text((length,)))
    else:
        ET.SubElement(geometry, "sphere", radius=_text((radius,)))


def _text(values: tuple[float, ...] | np.ndarray) -> str:
    return " ".join(f"{round(float(value), 15) + 0.0:.12g}" for value in values)


def main() -> None:
    """Write both arms beside this module."""
    here = Path(__file__).parent
    write_arm(here / "six_axis/six_axis.urdf", SIX_AXIS_DH, SIX_AXIS_LIMITS, SIX_AXIS_BODIES)
    write_arm(
        here / "seven_axis/seven_axis.urdf", SEVEN_AXIS_DH, SEVEN_AXIS_LIMITS, SEVEN_AXIS_BODIES
    )


if __name__ == "__main__":
    main()
