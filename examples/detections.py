"""A stand-in for a detector: the mug as vision_msgs/Detection3DArray, its class named `cup`.

grasp_planner_node --ros-args -p pose_type:=detection3d_array -p "class_ids:=['cup=mug']"
python detections.py
"""

from contextlib import suppress

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from vision_msgs.msg import (
    Detection3D,
    Detection3DArray,
    ObjectHypothesis,
    ObjectHypothesisWithPose,
)


class Detector(Node):
    """Publishes one detection with one hypothesis, five times a second."""

    def __init__(self) -> None:
        super().__init__("detector")
        self._publisher = self.create_publisher(Detection3DArray, "detections", 5)
        self.create_timer(0.2, self._publish)

    def _publish(self) -> None:
        array = Detection3DArray()
        array.header.frame_id = "cell"
        array.header.stamp = self.get_clock().now().to_msg()
        seen = ObjectHypothesisWithPose(hypothesis=ObjectHypothesis(class_id="cup", score=0.9))
        seen.pose.pose.position.x, seen.pose.pose.position.z = 0.5, 0.7975
        seen.pose.pose.orientation.w = 1.0
        array.detections = [Detection3D(header=array.header, results=[seen])]
        self._publisher.publish(array)


# rclpy's own handler takes the context from under a callback that is about to publish.
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
with suppress(KeyboardInterrupt):
    rclpy.spin(Detector())
rclpy.shutdown()
