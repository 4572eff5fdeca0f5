"""What the node publishes: the last grasp, for executives and RViz, and the hand's description."""

from __future__ import annotations

import threading
from collections.abc import Sequence

from ament_index_python.packages import PackageNotFoundError, get_package_share_path
from geometry_msgs.msg import PoseArray, PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from gpis_grasp_msgs.msg import Grasp
from gpis_grasp_planner.hand.description import HandDescription, urdf_text
from gpis_grasp_planner.ros.markers import GraspMarkers

# A late subscriber (that asks for transient_local, too) gets the last one.
LATCHED_QOS = QoSProfile(
    depth=1,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)

MARKER_PERIOD_S = 0.1


class GraspPublishers:
    """Publishes the best grasp of each successful answer; every message has the same header."""

    def __init__(self, node: Node, hand: HandDescription) -> None:
        urdf = urdf_text(hand, _mesh_uri_prefix(hand))
        self._markers = GraspMarkers(hand, urdf)
        self._not_drawn: Grasp | None = None
        self._lock = threading.Lock()  # messages of two answers must not mix
        self._grasp = node.create_publisher(Grasp, "grasp", LATCHED_QOS)
        self._palm_pose = node.create_publisher(PoseStamped, "palm_pose", LATCHED_QOS)
        self._palm_poses = node.create_publisher(PoseArray, "palm_poses", LATCHED_QOS)
        self._joints = node.create_publisher(JointState, "grasp_joint_states", LATCHED_QOS)
        self._marker_array = node.create_publisher(MarkerArray, "grasp_markers", LATCHED_QOS)
        self._description = node.create_publisher(String, "robot_description", LATCHED_QOS)
        self._description.publish(String(data=urdf))
        self._drawing = node.create_timer(MARKER_PERIOD_S, self._draw)

    def publish(self, grasps: Sequence[Grasp]) -> None:
        """Publish the first of the grasps on all topics, and where the palm is in each of them.

        Its markers follow within two `MARKER_PERIOD_S`: they take longer than the answer, and
        nobody looks at more of them.
        """
        best = grasps[0]
        palms = PoseArray(
            header=best.palm_pose.header, poses=[grasp.palm_pose.pose for grasp in grasps]
        )
        with self._lock:
            self._grasp.publish(best)
            self._palm_pose.publish(best.palm_pose)
            self._joints.publish(best.grasp)
            self._palm_poses.publish(palms)
            self._not_drawn = best
            if self._drawing.is_canceled():
                self._drawing.reset()

    def _draw(self) -> None:
        with self._lock:
            grasp, self._not_drawn = self._not_drawn, None
            if grasp is None:
                self._drawing.cancel()  # it does not wake the executor until there is another
                return
        self._marker_array.publish(self._markers.array(grasp))


def _mesh_uri_prefix(hand: HandDescription) -> str | None:
    """``package://`` where the package is installed: RViz may run on another machine.

    None otherwise (started from the sources without colcon): ``file://`` URIs of this machine.
    """
    name = __name__.partition(".")[0]
    inside = hand.urdf_path.parent.as_posix().rpartition(f"/{name}/")[2]
    try:
        installed = (get_package_share_path(name) / inside).is_dir()
    except PackageNotFoundError:
        installed = False
    return f"package://{name}/{inside}" if installed else None
