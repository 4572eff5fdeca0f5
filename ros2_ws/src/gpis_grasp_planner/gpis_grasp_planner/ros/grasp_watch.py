"""What a node publishes, as grasps and poses of the core: for viewers outside of ROS.

The counterpart of `ros.conversions`: from messages in a world frame to a grasp in the object's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np
import rclpy
from geometry_msgs.msg import Pose, PoseStamped, Vector3
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from gpis_grasp_msgs.msg import Grasp as GraspMessage
from gpis_grasp_msgs.msg import GraspVerification
from gpis_grasp_planner.errors import GraspPlannerError, RequestError
from gpis_grasp_planner.geometry.transforms import apply, from_position_quat_xyzw, inverse
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.trials import TrialOutcome, Trials
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.ros.qos import LATCHED_QOS

Array = NDArray[np.float64]
NODE_NAME = "grasp_viewer"
_SPIN_S = 0.2


@dataclass(frozen=True, eq=False)
class SeenGrasp:
    """A published grasp.

    Attributes
    ----------
    mesh_id, mesh_hash : str
    frame_id : str
        Of the pose.
    T_world_object : (4, 4) array
    grasp : Grasp
        In the object's frame.
    """

    mesh_id: str
    mesh_hash: str
    frame_id: str
    T_world_object: Array
    grasp: Grasp


class GraspWatch:
    """Listens to `grasp` and `grasp_object_pose`; a context manager.

    Parameters
    ----------
    hand : HandDescription
        That of the node.
    on_grasp : callable
        Called with a :class:`SeenGrasp` for each grasp, by :meth:`spin`.
    on_trouble : callable
        Called with a text where one cannot be shown.
    namespace : str
        Of the node.
    """

    def __init__(
        self,
        hand: HandDescription,
        on_grasp: Callable[[SeenGrasp], None],
        on_trouble: Callable[[str], None],
        namespace: str = "/",
    ) -> None:
        self._hand, self._on_grasp, self._on_trouble = hand, on_grasp, on_trouble
        self._grasp: GraspMessage | None = None
        self._pose: PoseStamped | None = None
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node(NODE_NAME, context=self._context, namespace=namespace)
        self._node.create_subscription(GraspMessage, "grasp", self._take_grasp, LATCHED_QOS)
        self._node.create_subscription(
            PoseStamped, "grasp_object_pose", self._take_pose, LATCHED_QOS
        )
        self.topic = self._node.resolve_topic_name("grasp")
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def spin(self) -> None:
        """Take what comes for a moment; to be called again and again."""
        self._executor.spin_once(timeout_sec=_SPIN_S)

    def _take_grasp(self, message: GraspMessage) -> None:
        self._grasp = message
        self._show()

    def _take_pose(self, message: PoseStamped) -> None:
        self._pose = message
        self._show()

    def _show(self) -> None:
        """Show the grasp with the object's pose of the same answer, whichever came first."""
        grasp, pose = self._grasp, self._pose
        if grasp is None or pose is None or grasp.palm_pose.header != pose.header:
            return
        self._grasp = None  # shown once
        try:
            self._on_grasp(seen_grasp(grasp, pose, self._hand))
        except GraspPlannerError as error:
            self._on_trouble(error.message)


def seen_grasp(message: GraspMessage, pose: PoseStamped, hand: HandDescription) -> SeenGrasp:
    """The grasp of a message, in the frame of the part whose pose came with it.

    Raises
    ------
    RequestError
        If its joints or links are not those of the hand.
    """
    if tuple(message.grasp.name) != hand.joint_names:
        raise RequestError(
            f"The node's hand has the joints {', '.join(message.grasp.name)}; those of "
            f"'{hand.name}' are others. Name the node's hand with --hand."
        )
    T_world_object = _matrix(pose.pose)
    T_object_world = inverse(T_world_object)
    rotate = T_object_world[:3, :3]
    probability = message.hold_probability
    grasp = Grasp(
        T_object_palm=T_object_world @ _matrix(message.palm_pose.pose),
        joints=hand.joint_count.of_planner(message.grasp.position),
        pregrasp_joints=hand.joint_count.of_planner(message.pre_grasp.position),
        contacts=_contacts(message, hand, T_object_world),
        quality=Quality(message.epsilon, message.volume),
        approach_direction=rotate @ _vector(message.approach_direction.vector),
        approach_distance=message.approach_distance,
        trials=_trials(message.verification),
        hold_probability=probability if probability >= 0.0 else None,
        lift_direction=rotate @ _vector(message.lift_direction.vector),
    )
    return SeenGrasp(
        message.mesh_id, message.mesh_hash, pose.header.frame_id, T_world_object, grasp
    )


def _contacts(message: GraspMessage, hand: HandDescription, T_object_world: Array) -> Contacts:
    contacts = message.contacts
    points = np.array([[c.position.x, c.position.y, c.position.z] for c in contacts])
    normals = np.array([_vector(c.normal_inward) for c in contacts])
    return Contacts(
        positions=apply(T_object_world, points.reshape(-1, 3)),
        normals_inward=normals.reshape(-1, 3) @ T_object_world[:3, :3].T,
        friction=np.array([c.friction for c in contacts], dtype=float),
        links=np.array([hand.link_names.index(c.link) for c in contacts], dtype=np.int64),
    )


def _trials(message: GraspVerification) -> Trials | None:
    """Names and verdicts; the causes of failures are not in the message."""
    if not message.attempted:
        return None
    passed = set(message.tests_passed)
    return Trials(tuple(TrialOutcome(name, name in passed) for name in message.tests_run))


def _matrix(pose: Pose) -> Array:
    p, q = pose.position, pose.orientation
    return np.asarray(from_position_quat_xyzw([p.x, p.y, p.z], [q.x, q.y, q.z, q.w]))


def _vector(vector: Vector3) -> Array:
    return np.array([vector.x, vector.y, vector.z])
