"""A robot executive that subscribes: palm pose and finger joints of each answered grasp.

Both are latched and have one stamp. The node answers whoever asks; this one only listens.

python executive.py [GRASPS]
"""

import sys

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState


class Executive(Node):
    """Pairs the two messages of a grasp by their stamp."""

    def __init__(self) -> None:
        super().__init__("executive")
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self.n_grasps = 0
        self._palms: dict[tuple[int, int], PoseStamped] = {}
        self._joints: dict[tuple[int, int], JointState] = {}
        self.create_subscription(PoseStamped, "palm_pose", self._on_palm, latched)
        self.create_subscription(JointState, "grasp_joint_states", self._on_joints, latched)

    def _on_palm(self, message: PoseStamped) -> None:
        self._palms[message.header.stamp.sec, message.header.stamp.nanosec] = message
        self._pair()

    def _on_joints(self, message: JointState) -> None:
        self._joints[message.header.stamp.sec, message.header.stamp.nanosec] = message
        self._pair()

    def _pair(self) -> None:
        for stamp in self._palms.keys() & self._joints.keys():
            palm, joints = self._palms.pop(stamp), self._joints.pop(stamp)
            p = palm.pose.position
            print(f"palm at {p.x:.3f} {p.y:.3f} {p.z:.3f} m in {palm.header.frame_id}", flush=True)
            for name, position in zip(joints.name, joints.position, strict=True):
                print(f"  {name} {position:.3f} rad", flush=True)
            self.n_grasps += 1


rclpy.init()
wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 1
executive = Executive()
while executive.n_grasps < wanted:
    rclpy.spin_once(executive, timeout_sec=0.2)
executive.destroy_node()
rclpy.shutdown()
