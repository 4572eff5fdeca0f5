"""What the node publishes: the last grasp, for executives and RViz, and the hand's description."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_path
from geometry_msgs.msg import Pose, PoseArray, PoseStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from gpis_grasp_msgs.msg import Grasp
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.hand.description import HandDescription, urdf_text
from gpis_grasp_planner.ros.hand_frames import HandFrames
from gpis_grasp_planner.ros.markers import GraspMarkers, ShownPart
from gpis_grasp_planner.ros.qos import LATCHED_QOS
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.steady_timer import steady_timer

MARKER_PERIOD_S = 0.1


class GraspPublishers:
    """Publishes the best grasp of each successful answer; every message has the same header.

    Parameters
    ----------
    node : Node
    hand : HandDescription
    plain_file : callable
        From a mesh ID to the file that viewers can show and its metres per unit, or None.
    settings : callable
        The node's settings at the moment of the call.
    """

    def __init__(
        self,
        node: Node,
        hand: HandDescription,
        plain_file: Callable[[str], tuple[Path, float] | None],
        settings: Callable[[], NodeSettings],
    ) -> None:
        urdf = urdf_text(hand, _mesh_uri_prefix(hand))
        self._markers = GraspMarkers(hand, urdf)
        self._frames = HandFrames(node, hand, settings)
        self._plain_file, self._settings = plain_file, settings
        self._not_drawn: tuple[Sequence[Grasp], Pose] | None = None
        self._lock = threading.Lock()  # messages of two answers must not mix
        self._grasp = node.create_publisher(Grasp, "grasp", LATCHED_QOS)
        self._palm_pose = node.create_publisher(PoseStamped, "palm_pose", LATCHED_QOS)
        self._palm_poses = node.create_publisher(PoseArray, "palm_poses", LATCHED_QOS)
        self._joints = node.create_publisher(JointState, "grasp_joint_states", LATCHED_QOS)
        self._object_pose = node.create_publisher(PoseStamped, "grasp_object_pose", LATCHED_QOS)
        self._marker_array = node.create_publisher(MarkerArray, "grasp_markers", LATCHED_QOS)
        self._description = node.create_publisher(String, "robot_description", LATCHED_QOS)
        self._description.publish(String(data=urdf))
        self._drawing = steady_timer(node, MARKER_PERIOD_S, self._draw)

    def publish(self, grasps: Sequence[Grasp], object_pose: Pose) -> None:
        """Publish the first of the grasps on all topics, and where the palm is in each of them.

        Markers and the hand's frames follow within two `MARKER_PERIOD_S`: they take longer than
        the answer, and nobody looks at more of them.

        Parameters
        ----------
        grasps : sequence of Grasp
            Messages, best first.
        object_pose : Pose
            Of the part, in the frame of the grasps.
        """
        best = grasps[0]
        header = best.palm_pose.header
        palms = PoseArray(header=header, poses=[grasp.palm_pose.pose for grasp in grasps])
        with self._lock:
            self._grasp.publish(best)
            self._palm_pose.publish(best.palm_pose)
            self._object_pose.publish(PoseStamped(header=header, pose=object_pose))
            self._joints.publish(best.grasp)
            self._palm_poses.publish(palms)
            self._not_drawn = grasps, object_pose
            if self._drawing.is_canceled():
                self._drawing.reset()

    def _draw(self) -> None:
        with self._lock:
            to_draw, self._not_drawn = self._not_drawn, None
            if to_draw is None:
                self._drawing.cancel()  # it does not wake the executor until there is another
                return
        grasps, object_pose = to_draw
        part = self._shown_part(grasps[0].mesh_id, object_pose)
        lifetime_s = self._settings().marker_lifetime_s
        self._frames.publish(grasps[0])
        self._marker_array.publish(self._markers.array(grasps, part, lifetime_s))

    def _shown_part(self, mesh_id: str, pose: Pose) -> ShownPart:
        """The part with its file, where viewers can read that as it is."""
        try:
            found = self._plain_file(mesh_id)
        except GraspPlannerError:  # gone since it was planned
            found = None
        if found is None:
            return ShownPart(pose)
        path, scale = found
        return ShownPart(pose, path.as_uri(), scale)


def _mesh_uri_prefix(hand: HandDescription) -> str | None:
    """``package://`` for a hand of the installed package: RViz may run on another machine.

    None otherwise (a hand from elsewhere, or started from the sources without colcon): ``file://``
    URIs of this machine.
    """
    name = __name__.partition(".")[0]
    folder, package = hand.urdf_path.resolve().parent, Path(__file__).resolve().parents[1]
    if not folder.is_relative_to(package):
        return None
    inside = folder.relative_to(package).as_posix()
    try:
        installed = (get_package_share_path(name) / inside).is_dir()
    except PackageNotFoundError:
        installed = False
    return f"package://{name}/{inside}" if installed else None
