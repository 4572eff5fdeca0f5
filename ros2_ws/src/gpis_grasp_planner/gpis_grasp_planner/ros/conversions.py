"""Planned grasps to messages: the only place where the object's pose meets the plan.

``T_world_palm = T_world_object @ T_object_palm``; "world" is the frame of the object's pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Vector3, Vector3Stamped
from numpy.typing import NDArray
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from gpis_grasp_msgs.action import PlanGrasp
from gpis_grasp_msgs.msg import Contact as ContactMessage
from gpis_grasp_msgs.msg import FunnelStep, GraspVerification, QualityFigure
from gpis_grasp_msgs.msg import Grasp as GraspMessage
from gpis_grasp_planner.geometry.transforms import apply, to_position_quat_xyzw
from gpis_grasp_planner.grasp.funnel import Funnel
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import HoldEstimate, Trials
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.quality.figures import ALWAYS, Figure, Quality, named
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
    return pose_messages(T[None])[0]


def pose_messages(T: Array) -> list[Pose]:
    """Poses of transforms (n, 4, 4)."""
    positions, quats = to_position_quat_xyzw(T)
    return [
        Pose(
            position=Point(x=p[0], y=p[1], z=p[2]),
            orientation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3]),
        )
        for p, q in zip(positions.tolist(), quats.tolist(), strict=True)
    ]


def point_message(point: Sequence[float]) -> Point:
    """Point [m]."""
    return Point(x=point[0], y=point[1], z=point[2])


def vector_message(vector: Sequence[float]) -> Vector3:
    """Vector."""
    return Vector3(x=vector[0], y=vector[1], z=vector[2])


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
        closing_slip=trials.outcomes[0].closing_slip_m,
        closing_rotation=trials.outcomes[0].closing_rotation_rad,
    )


def figure_messages(quality: Quality, meanings: Sequence[Figure]) -> list[QualityFigure]:
    """All figures of a quality that have a meaning among these, in the quality's order."""
    meaning = named(meanings)
    return [
        QualityFigure(
            name=name,
            value=float(value),
            unit=meaning[name].unit,
            larger_is_better=meaning[name].larger_is_better,
        )
        for name, value in quality.figures.items()
        if name in meaning
    ]


@dataclass(frozen=True)
class MeshVersion:
    """Which mesh a grasp is of; the hash is "" where it is not known yet."""

    mesh_id: str
    mesh_hash: str = ""
    figures: tuple[Figure, ...] = ALWAYS


def grasp_message(
    grasp: Grasp,
    plan: Plan | MeshVersion,
    pose: ObjectPose,
    hand: HandDescription,
    T_palm_flange: Array | None = None,
) -> GraspMessage:
    """One grasp where the object lies; see :func:`grasp_messages`."""
    return grasp_messages([grasp], plan, pose, hand, T_palm_flange)[0]


def grasp_messages(
    grasps: Sequence[Grasp],
    plan: Plan | MeshVersion,
    pose: ObjectPose,
    hand: HandDescription,
    T_palm_flange: Array | None = None,
) -> list[GraspMessage]:
    """Grasps where the object lies; without `T_palm_flange` the flange's pose is the palm's."""
    if not grasps:
        return []
    R_world_object = pose.T_world_object[:3, :3]
    T_world_palm = pose.T_world_object @ np.array([grasp.T_object_palm for grasp in grasps])
    approach = np.array([grasp.approach_direction for grasp in grasps]) @ R_world_object.T
    distance = np.array([grasp.approach_distance for grasp in grasps])
    away = np.array([grasp.way_out for grasp in grasps]) @ R_world_object.T
    palms = pose_messages(T_world_palm)
    flanges = palms
    if T_palm_flange is not None:
        flanges = pose_messages(T_world_palm @ T_palm_flange)
    starts = (T_world_palm[:, :3, 3] - distance[:, None] * approach).tolist()
    header = header_message(pose)
    return [
        _grasp_message(grasp, plan, pose, hand, header, palm, flange, *vectors)
        for grasp, palm, flange, *vectors in zip(
            grasps, palms, flanges, starts, approach.tolist(), away.tolist(), strict=True
        )
    ]


def _grasp_message(
    grasp: Grasp,
    plan: Plan | MeshVersion,
    pose: ObjectPose,
    hand: HandDescription,
    header: Header,
    palm: Pose,
    flange: Pose,
    start: list[float],
    approach: list[float],
    away: list[float],
) -> GraspMessage:
    positions = apply(pose.T_world_object, grasp.contacts.positions)
    normals = grasp.contacts.normals_inward @ pose.T_world_object[:3, :3].T
    pregrasp = Pose(position=point_message(start), orientation=palm.orientation)
    return GraspMessage(
        mesh_id=plan.mesh_id,
        mesh_hash=plan.mesh_hash,
        palm_pose=PoseStamped(header=header, pose=palm),
        flange_pose=PoseStamped(header=header, pose=flange),
        pre_grasp=_posture(header, hand, grasp.pregrasp_joints),
        grasp=_posture(header, hand, grasp.joints),
        pre_grasp_palm_pose=PoseStamped(header=header, pose=pregrasp),
        approach_direction=Vector3Stamped(header=header, vector=vector_message(approach)),
        approach_distance=float(grasp.approach_distance),
        lift_direction=Vector3Stamped(header=header, vector=vector_message(away)),
        hold_probability=-1.0 if grasp.hold_probability is None else float(grasp.hold_probability),
        epsilon=float(grasp.epsilon),
        volume=float(grasp.volume),
        figures=figure_messages(grasp.quality, plan.figures),
        verification=verification_message(grasp.trials, grasp.hold_estimate),
        **_arm_fields(header, grasp),
        contacts=[
            ContactMessage(
                link=hand.link_names[link],
                position=point_message(position),
                normal_inward=vector_message(normal),
                friction=friction,
            )
            for link, position, normal, friction in zip(
                grasp.contacts.links,
                positions.tolist(),
                normals.tolist(),
                np.asarray(grasp.contacts.friction, dtype=float).tolist(),
                strict=True,
            )
        ],
    )


def _posture(header: Header, hand: HandDescription, joints: Array) -> JointState:
    """Joints (J,) as the hand's URDF counts them."""
    return joint_state_message(header, hand.joint_names, hand.joint_count.of_urdf(joints))


def _arm_fields(header: Header, grasp: Grasp) -> dict[str, Any]:
    """The arm's joints; none without an arm."""
    if (arm := grasp.arm) is None:
        return {}
    return {
        "arm_pre_grasp": joint_state_message(header, arm.joint_names, arm.pregrasp),
        "arm_grasp": joint_state_message(header, arm.joint_names, arm.grasp),
        "arm_lifted": joint_state_message(header, arm.joint_names, arm.lifted),
        "arm_manipulability": float(arm.manipulability),
    }


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
