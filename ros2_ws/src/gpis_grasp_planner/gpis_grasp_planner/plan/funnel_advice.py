"""What can be done about the step at which most grasps are lost."""

from __future__ import annotations

from gpis_grasp_planner.grasp.funnel import Funnel, Loss, Step

_BY_CAUSE = {
    Loss.DEEP: "No place along the surface's normal is free for the open hand. Check that the "
    "mesh's faces look outward, or give more time.",
    Loss.PALM: "The open hand mostly meets the part before it closes, as it does on parts that "
    "are hollow or about as large as the hand. Give more time.",
    Loss.ITSELF: "The fingers mostly meet each other before the part, which is thin for this "
    "hand. Give more time, or use a hand with a finer grip.",
    Loss.NOTHING: "The hand mostly closes on air. Check the mesh's unit, or use a hand of the "
    "part's size.",
    Loss.ONE: "The hand mostly touches with one link only. Check the mesh's unit, or give more "
    "time.",
    Loss.SLACK: "The contacts mostly do not oppose each other at this friction. Check the "
    "friction, or give more time.",
    Loss.WAY_BACK: "The part is mostly in the way of the open hand as it comes. Give more time, "
    "or a smaller scene.retreat_m.",
    Loss.NEAR: "All grasps are near to one another. Give more time.",
    Loss.BEYOND: "There was no time to look at a grasp exactly. Give more time.",
    Loss.INEXACT: "The exact figures deny what the search estimated. Give more time.",
    Loss.MARGIN: "The grasps come too near to the surroundings. Move the part or the obstacle, "
    "or give a smaller clearance.margin_m.",
    Loss.SCENE: "PyBullet's scene mostly sees other contacts (scene.confirm_tolerance_m). Check "
    "the mesh for overlapping faces.",
    Loss.NO_TIME: "No grasp could be tried in physics in time. Give more time, or ask without "
    "verification.",
}
_BY_STEP = {
    Step.PALM_FREE: "'{cause}' mostly forbids the hand before it closes. Move the part or what "
    "stands around it, or allow other directions.",
    Step.CLEAR: "Most grasps with force closure are forbidden by the surroundings or the request "
    "('{cause}'). Move the part or the obstacle, allow more directions, or give a smaller "
    "clearance.margin_m.",
    Step.HELD: "Most grasps that were tried did not hold in physics ('{cause}'). Check the "
    "friction and verification.mass_kg, or give more time.",
}


def advice(funnel: Funnel) -> str:
    """One or two sentences on the main loss and its cure; "" where nothing was lost."""
    main = funnel.main_loss
    if main is None:
        return ""
    step, cause = main
    for loss, text in _BY_CAUSE.items():
        if cause == loss:
            return text
    return _BY_STEP[step].format(cause=cause)
