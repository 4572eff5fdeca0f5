"""The constraints of one plan: made of what was asked for and of where the part lies."""

from __future__ import annotations

import numpy as np

from gpis_grasp_planner.arm.constraint import ArmConstraint
from gpis_grasp_planner.arm.description import load_arm
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.constraint import Constraint
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.context import palm_face_height
from gpis_grasp_planner.surroundings.approach_constraint import ApproachConstraint
from gpis_grasp_planner.surroundings.obstacle_constraint import ObstacleConstraint
from gpis_grasp_planner.surroundings.place import Place
from gpis_grasp_planner.surroundings.region_constraint import RegionConstraint
from gpis_grasp_planner.surroundings.support_constraint import SupportConstraint


def make_constraints(
    hand: HandDescription,
    request: PlanRequest,
    place: Place,
    settings: PlannerSettings,
    arm: ArmConstraint | None = None,
    own: tuple[Constraint, ...] = (),
) -> tuple[Constraint, ...]:
    """Everything that the grasps of a plan must respect, the cheapest to ask first.

    Parameters
    ----------
    hand : HandDescription
    request : PlanRequest
        Its `approach` and `forbidden`.
    place : Place
        Its surroundings, seen from the part.
    settings : PlannerSettings
    arm : ArmConstraint, optional
        Of the place where the part really lies (`arm_constraint`).
    own : tuple of Constraint
        Those of the settings (`own_constraints`), what they cost being unknown.

    Returns
    -------
    tuple of Constraint
        Empty for a part that floats in free space and a request that forbids nothing.
    """
    margin, retreat = settings.clearance.margin_m, settings.scene.retreat_m
    around = place.around()
    made: list[Constraint] = []
    if (cone := request.approach) is not None:
        T_palm_face = np.eye(4)
        T_palm_face[2, 3] = palm_face_height(hand)
        axis = cone.axis_in_object(place.T_world_object)
        made.append(ApproachConstraint(axis, cone.half_angle_deg, T_palm_face))
    if around.support is not None:
        made.append(SupportConstraint(hand, around.support, margin, retreat))
    if around.obstacles:
        made.append(ObstacleConstraint(hand, around.obstacles, settings.clearance, retreat))
    made += [
        RegionConstraint(hand, region, settings.clearance, retreat) for region in request.forbidden
    ]
    made += own
    if arm is not None:
        made.append(arm)
    return tuple(made)


def arm_constraint(
    hand: HandDescription, part: Part, place: Place, settings: PlannerSettings
) -> ArmConstraint | None:
    """The arm of the settings before the part where it lies; None without an arm.

    Raises
    ------
    RequestError
        If there is no such arm, or the extra 'arm' is not installed.
    """
    if not settings.arm.model:
        return None
    return ArmConstraint(
        load_arm(settings.arm.model),
        hand,
        part.working_mesh,
        place,
        settings.arm,
        settings.scene.retreat_m,
    )
