"""Demo of a cell: detections from a moving camera, a tf tree, and an executive with the action.

Three processes: the node; a stand-in for camera, estimator and robot, which publishes
``vision_msgs/Detection3DArray`` in the camera's frame and the frames on tf; and this one, the
executive, which sends a goal, shows its feedback and prints what a robot needs of the result.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

# Set before rclpy is imported: the demo shall neither hear nor disturb what else runs here.
os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 101))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.signals import SignalHandlerOptions
from scipy.spatial.transform import Rotation
from tf2_msgs.msg import TFMessage
from vision_msgs.msg import (
    Detection3D,
    Detection3DArray,
    ObjectHypothesis,
    ObjectHypothesisWithPose,
)

from gpis_grasp_msgs.action import PlanGrasp

BASE, TABLE, ARM, CAMERA = "robot_base", "table", "arm_tip", "camera"
TABLE_HEIGHT_M = 0.75
# The mug stands on the table: its frame is in its middle, 47.5 mm above its bottom.
MUG_IN_BASE = (0.6, 0.1, TABLE_HEIGHT_M + 0.0475)
CLASS_ID, MESH_ID = "cup_blue", "mug"
FLANGE_BEHIND_PALM_M = 0.12
BUDGET_S, WAIT_S, ATTEMPTS = 15.0, 90.0, 60


def pose_matrix(position: Any, rotation: Rotation) -> np.ndarray:
    """Homogeneous matrix (4, 4)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.as_matrix(), position
    return T


def camera_in_arm() -> np.ndarray:
    """Where the camera is mounted: beside the tool, looking along it."""
    return pose_matrix((0.05, 0.0, 0.08), Rotation.from_euler("z", 90.0, degrees=True))


def arm_in_base(t_s: float) -> np.ndarray:
    """Where the arm's tip is: it swings to and fro above the table, looking down."""
    x = 0.5 + 0.15 * math.sin(0.5 * t_s)
    tilt = Rotation.from_euler("xyz", (180.0 + 10.0 * math.sin(0.7 * t_s), 0.0, 0.0), degrees=True)
    return pose_matrix((x, 0.1, 1.4), tilt)


class Cell(Node):
    """Stands in for the robot's and the camera's drivers and for the pose estimator."""

    def __init__(self) -> None:
        super().__init__("cell_stand_in")
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self._static = self.create_publisher(TFMessage, "/tf_static", latched)
        self._moving = self.create_publisher(TFMessage, "/tf", 50)
        self._detections = self.create_publisher(Detection3DArray, "detections", 5)
        fixed = [
            (BASE, TABLE, pose_matrix((0.0, 0.0, TABLE_HEIGHT_M), Rotation.identity())),
            (ARM, CAMERA, camera_in_arm()),
        ]
        now = self.get_clock().now()
        self._static.publish(TFMessage(transforms=[self._message(now, *row) for row in fixed]))
        self.create_timer(0.02, self._move)
        self.create_timer(0.2, self._see)

    @staticmethod
    def _message(now: Any, parent: str, child: str, T: np.ndarray) -> TransformStamped:
        message = TransformStamped(child_frame_id=child)
        message.header.frame_id, message.header.stamp = parent, now.to_msg()
        t, r = message.transform.translation, message.transform.rotation
        t.x, t.y, t.z = map(float, T[:3, 3])
        r.x, r.y, r.z, r.w = map(float, Rotation.from_matrix(T[:3, :3]).as_quat())
        return message

    def _move(self) -> None:
        now = self.get_clock().now()
        T = arm_in_base(now.nanoseconds / 1e9)
        self._moving.publish(TFMessage(transforms=[self._message(now, BASE, ARM, T)]))

    def _see(self) -> None:
        now = self.get_clock().now()
        T_base_camera = arm_in_base(now.nanoseconds / 1e9) @ camera_in_arm()
        T_base_mug = pose_matrix(MUG_IN_BASE, Rotation.from_euler("z", 30.0, degrees=True))
        seen = self._message(now, CAMERA, "", np.linalg.inv(T_base_camera) @ T_base_mug)
        found = ObjectHypothesisWithPose(hypothesis=ObjectHypothesis(class_id=CLASS_ID, score=0.93))
        t = seen.transform.translation
        position = found.pose.pose.position
        position.x, position.y, position.z = t.x, t.y, t.z
        found.pose.pose.orientation = seen.transform.rotation
        array = Detection3DArray(header=seen.header)
        array.detections = [Detection3D(header=seen.header, results=[found])]
        self._detections.publish(array)


class Executive(Node):
    """Sends a goal and waits for its result."""

    def __init__(self) -> None:
        super().__init__("executive")
        self._client = ActionClient(self, PlanGrasp, "plan_grasp")
        self._phase = ""

    def plan(self) -> Any:
        """The result of a goal; asked again until the estimate and the frames have been heard."""
        if not self._client.wait_for_server(WAIT_S):
            raise RuntimeError("The action plan_grasp is not there.")
        goal = PlanGrasp.Goal(mesh_id=MESH_ID, time_budget=BUDGET_S, target_frame=BASE, n_grasps=5)
        goal.support_plane.header.frame_id = TABLE
        goal.support_plane.pose.orientation.w = 1.0
        for _ in range(ATTEMPTS):
            sent = self._client.send_goal_async(goal, feedback_callback=self._on_feedback)
            rclpy.spin_until_future_complete(self, sent, timeout_sec=WAIT_S)
            ended = sent.result().get_result_async()
            rclpy.spin_until_future_complete(self, ended, timeout_sec=WAIT_S)
            result = ended.result().result
            early = (result.NO_POSE_ESTIMATE, result.NO_TRANSFORM, result.TRANSFORM_STALE,
                     result.DEADLINE_EXCEEDED)  # fmt: skip
            if result.code not in early:
                return result
            time.sleep(0.5)
        return result

    def _on_feedback(self, message: Any) -> None:
        feedback = message.feedback
        if feedback.phase != self._phase:
            self._phase = feedback.phase
            print(
                f"  {feedback.elapsed:5.1f} s  {feedback.phase:10s} {feedback.evaluations} grasps "
                f"attempted, {feedback.n_held} of {feedback.n_tried} held in physics"
            )


@contextmanager
def process(command: list[str]) -> Iterator[None]:
    """Run a process beside this one and end it with SIGTERM."""
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        child.send_signal(signal.SIGTERM)
        try:
            child.wait(timeout=15.0)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()


def show(name: str, message: Any) -> None:
    """Print a pose with its frame."""
    p, q = message.pose.position, message.pose.orientation
    print(
        f"  {name:20s} {p.x:7.3f} {p.y:7.3f} {p.z:7.3f} m, {q.x:6.3f} {q.y:6.3f} {q.z:6.3f} "
        f"{q.w:6.3f} in {message.header.frame_id}"
    )


def run() -> int:
    """Play the demo; 0 if there is a grasp."""
    parameters = {
        "pose_type": "detection3d_array",
        "class_ids": f"['{CLASS_ID}={MESH_ID}']",
        "palm_flange_pose": f"'0 0 {-FLANGE_BEHIND_PALM_M} 0 0 0 1'",
    }
    node = [sys.executable, "-m", "gpis_grasp_planner.ros.node", "--ros-args"]
    for name, value in parameters.items():
        node += ["-p", f"{name}:={value}"]
    with ExitStack() as stack:
        stack.enter_context(process(node))
        stack.enter_context(process([sys.executable, __file__, "--cell"]))
        rclpy.init()
        stack.callback(rclpy.try_shutdown)
        executive = Executive()
        stack.callback(executive.destroy_node)
        print(f"A goal for '{MESH_ID}', seen as '{CLASS_ID}' by a moving camera, in {BASE}:")
        result = executive.plan()
    print(result.message)
    for note in result.notes:
        print(f"  note: {note}")
    if not result.success:
        return 1
    best = result.grasps[0]
    show("pre-grasp palm", best.pre_grasp_palm_pose)
    show("palm", best.palm_pose)
    show("flange", best.flange_pose)
    closed = ", ".join(f"{q:.2f}" for q in best.grasp.position)
    print(f"  finger joints        {closed} rad")
    print(f"  epsilon {best.epsilon:.3f}, held in physics: {best.verification.held}")
    return 0


def main() -> int:
    """Parse the options and play."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cell", action="store_true", help=argparse.SUPPRESS)
    if parser.parse_args().cell:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        with suppress(KeyboardInterrupt):
            rclpy.spin(Cell())
        rclpy.shutdown()
        return 0
    return run()


if __name__ == "__main__":
    sys.exit(main())
