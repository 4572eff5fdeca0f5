"""A stand-in for a pose estimator: publishes a part's pose five times a second.

python pose_estimator.py
ros2 service call /plan_grasp gpis_grasp_msgs/srv/PlanGrasp "{mesh_id: mug, time_budget: 5.0}"
"""

from contextlib import suppress

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions


class PoseEstimator(Node):
    """The pose is that of the CAD file's own origin, stamped with the time of the picture."""

    def __init__(self) -> None:
        super().__init__("pose_estimator")
        self._publisher = self.create_publisher(PoseStamped, "object_pose", 5)
        self.create_timer(0.2, self._publish)

    def _publish(self) -> None:
        message = PoseStamped()
        message.header.frame_id = "cell"
        message.header.stamp = self.get_clock().now().to_msg()
        message.pose.position.x, message.pose.position.z = 0.5, 0.7975
        message.pose.orientation.w = 1.0
        self._publisher.publish(message)


# rclpy's own handler takes the context from under a callback that is about to publish.
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
with suppress(KeyboardInterrupt):
    rclpy.spin(PoseEstimator())
rclpy.shutdown()
