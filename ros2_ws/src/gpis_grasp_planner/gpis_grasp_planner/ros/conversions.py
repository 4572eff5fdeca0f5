"""Planned grasps to messages: the only place where the object's pose meets the plan.

``T_world_palm = T_world_object @ T_object_palm``; "world" is the frame of the object's pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3, Vector3Stamped
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from gpis_grasp_msgs.action import PlanGrasp
from gpis_grasp_msgs.msg import Contact as ContactMessage
from gpis_grasp_msgs.msg import FunnelStep, GraspVerification
from gpis_grasp_msgs.msg import Grasp as GraspMessage
from gpis_grasp_planner.geometry.transforms import apply, to_position_quat_xyzw
from gpis_grasp_planner.grasp.funnel import Funnel
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import HoldEstimate, Trials
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.request_guard import NANOSECONDS, ObjectPose
from gpis_grasp_planner.ros.worker.messages import Plan

Array = NDArray[np.float64]


def header_message(pose: ObjectPose) -> Header:
    """Frame and stamp that everything derived from an object pose carries."""
    seconds, nanoseconds = divmod(pose.stamp_ns, NANOSECONDS)
    return Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=pose.frame_id)


def funnel_messages(funnel: Funnel) -> list[FunnelStep]:
    """One message a step; none where nothing was proposed."""
    if not funnel.proposed:
        return []
    return [
        FunnelStep(name=str(step), passed=left, causes=list(causes), lost=list(causes.values()))
        for step, left, causes in funnel.table
    ]


def pose_message(T: Array) -> Pose:
    """Pose of a transform (4, 4); the quaternion has w >= 0."""
    position, quat = to_position_quat_xyzw(T)
    return Pose(
        position=point_message(position),
        orientation=Quaternion(x=quat[0], y=quat[1], z=quat[2], w=quat[3]),
    )


def point_message(point: Array) -> Point:
    """Point from an array (3,) [m]."""
    return Point(x=float(point[0]), y=float(point[1]), z=float(point[2]))


def vector_message(vector: Array) -> Vector3:
    """Vector from an array (3,)."""
    return Vector3(x=float(vector[0]), y=float(vector[1]), z=float(vector[2]))


def joint_state_message(header: Header, names: Sequence[str], positions: Array) -> JointState:
    """Positions [rad] of all joints of the hand."""
    return JointState(header=header, name=list(names), position=[float(q) for q in positions])


def verification_message(
    trials: Trials | None, estimate: HoldEstimate | None = None
) -> GraspVerification:
    """What physics said about a grasp; not attempted where there is None."""
    probabilities = (
        {}
        if estimate is None
        else {
            "probability": float(estimate.probability),
            "probability_low": float(estimate.low),
            "probability_high": float(estimate.high),
        }
    )
    if trials is None:
        return GraspVerification(**probabilities)
    return GraspVerification(
        **probabilities,
        attempted=True,
        held=trials.held,
        tests_run=[outcome.name for outcome in trials.outcomes],
        tests_passed=[outcome.name for outcome in trials.outcomes if outcome.passed],
        largest_slip=trials.largest_slip_m,
        largest_rotation=trials.largest_rotation_rad,
    )


@dataclass(frozen=True)
class MeshVersion:
    """Which mesh a grasp is of; the hash is "" where it is not known yet."""

    mesh_id: str
    mesh_hash: str = ""


def grasp_message(
    grasp: Grasp,
    plan: Plan | MeshVersion,
    pose: ObjectPose,
    hand: HandDescription,
    T_palm_flange: Array | None = None,
) -> GraspMessage:
    """One grasp where the object lies; without `T_palm_flange` the flange's pose is the palm's."""
    header = header_message(pose)
    T_world_object = pose.T_world_object
    T_world_palm = T_world_object @ grasp.T_object_palm
    R_world_object = T_world_object[:3, :3]
    direction = R_world_object @ grasp.approach_direction
    palm = pose_message(T_world_palm)
    pregrasp = Pose(
        position=point_message(T_world_palm[:3, 3] - grasp.approach_distance * direction),
        orientation=palm.orientation,
    )
    flange = palm if T_palm_flange is None else pose_message(T_world_palm @ T_palm_flange)
    positions = apply(T_world_object, grasp.contacts.positions)
    normals = grasp.contacts.normals_inward @ R_world_object.T
    return GraspMessage(
        mesh_id=plan.mesh_id,
        mesh_hash=plan.mesh_hash,
        palm_pose=PoseStamped(header=header, pose=palm),
        flange_pose=PoseStamped(header=header, pose=flange),
        pre_grasp=joint_state_message(header, hand.joint_names, grasp.pregrasp_joints),
        grasp=joint_state_message(header, hand.joint_names, grasp.joints),
        pre_grasp_palm_pose=PoseStamped(header=header, pose=pregrasp),
        approach_direction=Vector3Stamped(header=header, vector=vector_message(direction)),
        approach_distance=float(grasp.approach_distance),
        lift_direction=Vector3Stamped(
            header=header, vector=vector_message(R_world_object @ grasp.way_out)
        ),
        hold_probability=-1.0 if grasp.hold_probability is None else float(grasp.hold_probability),
        epsilon=float(grasp.epsilon),
        volume=float(grasp.volume),
        verification=verification_message(grasp.trials, grasp.hold_estimate),
        contacts=[
            ContactMessage(
                link=hand.link_names[link],
                position=point_message(position),
                normal_inward=vector_message(normal),
                friction=float(friction),
            )
            for link, position, normal, friction in zip(
                grasp.contacts.links, positions, normals, grasp.contacts.friction, strict=True
            )
        ],
    )


def feedback_message(call: Call) -> PlanGrasp.Feedback:
    """How far the work for a goal is, and its best grasp that held so far."""
    progress = call.progress
    if progress is None:
        return PlanGrasp.Feedback(phase="waiting", elapsed=call.elapsed_s, best_epsilon=-1.0)
    return PlanGrasp.Feedback(
        phase=str(progress.phase),
        share_done=progress.share_done,
        elapsed=call.elapsed_s,
        evaluations=progress.evaluations,
        best_epsilon=float(progress.best_epsilon),
        n_candidates=progress.n_candidates,
        n_tried=progress.n_tried,
        n_held=progress.n_held,
        best_verified=[] if progress.best_held is None else [call.show(progress.best_held)],
    )
