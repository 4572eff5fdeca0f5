"""Joints that a URDF says mimic others must move so by the hand's description as well.

What closes and what is set before is said by the description's table and gains. A URDF that
couples joints in another way, or couples one that the description does not name, would be planned
with as another hand.
"""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.drive_train import Drive
from gpis_grasp_planner.hand.finger import Finger
from gpis_grasp_planner.hand.preshape import Preshape
from gpis_grasp_planner.hand.urdf import UrdfTree

_TOLERANCE = 1e-3
_SAME_PLACE = 1e-6  # of the open hand [rad or m]


def check_mimic(
    tree: UrdfTree, preshape: Preshape, fingers: tuple[Finger, ...], drive: Drive
) -> None:
    """Refuse a description that moves a joint otherwise than the URDF's <mimic> says.

    Raises
    ------
    RequestError
    """
    finger_of = {joint: finger for finger in fingers for joint in finger.joints}
    for joint, mimic in enumerate(tree.joint_mimic):
        if mimic is None:
            continue
        master, multiplier, offset = mimic
        name, other = tree.joint_names[joint], tree.joint_names[master]
        said = f"The URDF says that joint '{name}' follows '{other}' times {multiplier:g}"
        if abs(offset) > _SAME_PLACE:
            raise RequestError(
                f"{said}, but the open hand has it {offset:g} from there. Leave its 'open_deg' or "
                "'open_mm' out, which is found from the <mimic> then, or make it agree."
            )
        own, of_other = finger_of.get(joint), finger_of.get(master)
        if own is None and of_other is None:
            gains = preshape.gain[:, [list(preshape.joints).index(j) for j in (joint, master)]]
            if not np.allclose(gains[:, 0], multiplier * gains[:, 1], atol=_TOLERANCE):
                raise RequestError(
                    f"{said}, but the gains of the pre-shape's motors are "
                    f"{gains[:, 0].tolist()} and {gains[:, 1].tolist()}. Make them agree."
                )
        elif own is None or of_other is None:
            raise RequestError(
                f"{said}, but only one of them closes by the description. Name '{name}' among the "
                "joints of the finger if it hangs on that; a bar beside a finger, of a parallel "
                "linkage, is not known: take it out of the URDF, its shapes fixed to the palm."
            )
        elif own is not of_other:
            if not (drive.coupled and multiplier == 1.0):
                raise RequestError(
                    f"{said}, a joint of another finger. Fingers that are coupled are known as two "
                    "jaws that slide alike ('drive: coupled'); for others take the <mimic> out of "
                    "the URDF, if each may close by itself until it touches."
                )
        else:
            row = own.closing_ratio[0]
            ratio, first = row[own.joints.index(joint)], row[own.joints.index(master)]
            if abs(ratio - multiplier * first) > _TOLERANCE * max(abs(multiplier), 1.0):
                raise RequestError(
                    f"{said}, but by the first row of the closing table of finger '{own.name}' "
                    f"{ratio:g} goes with {first:g}. Make them agree."
                )
