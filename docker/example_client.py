"""Ask the planner for a grasp once and print it: the smallest client.

Usage: python docker/example_client.py [MESH_ID]
"""

from __future__ import annotations

import sys

import rclpy
from rclpy.node import Node

from gpis_grasp_msgs.srv import PlanGrasp

ATTEMPTS = 3
ANSWER_TIMEOUT_S = 60.0  # a service call over DDS can get lost: give up, and ask again


def request_for(mesh_id: str) -> PlanGrasp.Request:
    """Build a request with the object half a metre in front of the robot, upright."""
    request = PlanGrasp.Request(mesh_id=mesh_id, time_budget=10.0, n_grasps=1)
    request.object_pose.header.frame_id = "base_link"
    request.object_pose.pose.position.x = 0.5
    request.object_pose.pose.orientation.w = 1.0
    return request


def call(node: Node, request: PlanGrasp.Request) -> PlanGrasp.Response | None:
    """Call the service; None if no answer came."""
    client = node.create_client(PlanGrasp, "/plan_grasp")
    for _ in range(ATTEMPTS):
        if client.wait_for_service(timeout_sec=10.0):
            future = client.call_async(request)
            rclpy.spin_until_future_complete(node, future, timeout_sec=ANSWER_TIMEOUT_S)
            if future.done():
                return future.result()
            client.remove_pending_request(future)
    return None


def main() -> int:
    """Print the best grasp; the exit code is 0 if there is one."""
    rclpy.init()
    node = Node("grasp_client")
    answer = call(node, request_for(sys.argv[1] if len(sys.argv) > 1 else "mug"))
    node.destroy_node()
    rclpy.shutdown()
    if answer is None:
        print("The service /plan_grasp did not answer: is grasp_planner_node running?")
        return 1
    print(answer.message)
    if not answer.success:
        return 1
    best = answer.grasps[0]
    p, q = best.palm_pose.pose.position, best.palm_pose.pose.orientation
    print(f"palm in {best.palm_pose.header.frame_id}: {p.x:.4f} {p.y:.4f} {p.z:.4f} m,", end=" ")
    print(f"orientation xyzw {q.x:.4f} {q.y:.4f} {q.z:.4f} {q.w:.4f}")
    for name, angle in zip(best.grasp.name, best.grasp.position, strict=True):
        print(f"  {name:16s} {angle:7.4f} rad")
    print(f"epsilon {best.epsilon:.4f}, volume {best.volume:.4f}, {len(best.contacts)} contacts")
    return 0


if __name__ == "__main__":
    sys.exit(main())
