"""Ask for a grasp in the robot's frame of a part that is known in the camera's.

The camera looks straight down from 1.5 m above the base; where it is, is on /tf_static.

python tf_frames.py
"""

import sys
import time

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

from gpis_grasp_msgs.srv import PlanGrasp

rclpy.init()
node = Node("caller")
latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
frames = node.create_publisher(TFMessage, "/tf_static", latched)
camera = TransformStamped(child_frame_id="camera")
camera.header.frame_id = "base"
camera.header.stamp = node.get_clock().now().to_msg()
camera.transform.translation.z = 1.5
camera.transform.rotation.x, camera.transform.rotation.w = 1.0, 0.0  # half a turn about x
frames.publish(TFMessage(transforms=[camera]))

request = PlanGrasp.Request(mesh_id="mug", time_budget=3.0, n_grasps=1, target_frame="base")
request.object_pose.header.frame_id = "camera"
request.object_pose.pose.position.z = 0.7  # in front of the lens
request.object_pose.pose.orientation.w = 1.0
client = node.create_client(PlanGrasp, "plan_grasp")
if not client.wait_for_service(timeout_sec=30.0):
    sys.exit("The service plan_grasp is not there: is grasp_planner_node running?")
while True:
    future = client.call_async(request)
    rclpy.spin_until_future_complete(node, future, timeout_sec=60.0)
    answer = future.result()
    if answer is None or answer.code != answer.NO_TRANSFORM:
        break
    time.sleep(0.2)  # the node has not heard of the frames yet
node.destroy_node()
rclpy.shutdown()
if answer is None or not answer.success:
    sys.exit("No answer." if answer is None else answer.message)
palm = answer.grasps[0].palm_pose
p = palm.pose.position
print(f"palm at {p.x:.3f} {p.y:.3f} {p.z:.3f} m in {palm.header.frame_id}")
