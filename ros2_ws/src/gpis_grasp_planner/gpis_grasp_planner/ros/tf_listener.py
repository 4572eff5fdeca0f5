"""Listens to /tf and /tf_static.

The tree is the node's own: ``tf2_ros`` is not among the ROS wheels, and one implementation is
tested everywhere. The messages are those of ``tf2_msgs``.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, QoSReliabilityPolicy

from gpis_grasp_planner.errors import ErrorCode, PoseError
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.text import printable
from gpis_grasp_planner.ros.transform_tree import TransformTree

Array = NDArray[np.float64]

# As tf2_ros: dynamic transforms from publishers of any kind, static ones also to late listeners.
DYNAMIC_QOS = QoSProfile(
    depth=100,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
)
STATIC_QOS = QoSProfile(
    depth=100,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
)
_WARNING_PERIOD_S = 5.0
_LOOK_S = 0.01


class TfListener:
    """Frames as they are published; says how to bring one into another.

    Parameters
    ----------
    node : Node
    settings : callable
        The node's settings at the moment of the call.

    Attributes
    ----------
    tree : TransformTree
    missing : str
        The name of what is not installed, else "".
    on_frame : callable
        Called with the name of each frame that was seen moving.
    """

    def __init__(self, node: Node, settings: Callable[[], NodeSettings]) -> None:
        self._node = node
        self._settings = settings
        self.tree = TransformTree()
        self.missing = ""
        self.on_frame: Callable[[str], None] = lambda _frame: None
        self._changed = threading.Condition()
        self._last_warning_s = -_WARNING_PERIOD_S
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            self.missing = "tf2_msgs"
            return
        group = MutuallyExclusiveCallbackGroup()
        for topic, static, qos in (("/tf", False, DYNAMIC_QOS), ("/tf_static", True, STATIC_QOS)):
            node.create_subscription(
                TFMessage,
                topic,
                lambda message, static=static: self._take(message, static),
                qos,
                callback_group=group,
            )

    def transform(self, target: str, source: str, stamp_ns: int) -> Array:
        """T_target_source (4, 4) at a time; waits a moment for a transform that is on its way.

        One that is only near in time (`tf_tolerance_s`) is taken after the wait, not before: the
        one that follows it says where a moving frame was.

        Raises
        ------
        PoseError
            NO_TRANSFORM or TRANSFORM_STALE.
        """
        if self.missing:
            raise PoseError(
                f"The frames '{printable(source, 60)}' and '{printable(target, 60)}' differ, and "
                f"the package {self.missing} is not installed, so that tf cannot be heard. Give "
                "everything in one frame, or install it.",
                ErrorCode.NO_TRANSFORM,
            )
        settings = self._settings()
        end = time.monotonic() + settings.tf_wait_s
        while True:
            left = end - time.monotonic()
            tolerance_s = settings.tf_tolerance_s if left <= 0.0 else 0.0
            try:
                return self.tree.look_up(target, source, stamp_ns, tolerance_s)
            except PoseError:
                if left <= 0.0:
                    raise
            with self._changed:
                self._changed.wait(min(left, _LOOK_S))

    def _take(self, message: Any, static: bool) -> None:
        for transform in message.transforms:
            t, q = transform.transform.translation, transform.transform.rotation
            stamp = transform.header.stamp
            why = self.tree.add(
                transform.header.frame_id,
                transform.child_frame_id,
                stamp.sec * 1_000_000_000 + stamp.nanosec,
                np.array([t.x, t.y, t.z]),
                np.array([q.x, q.y, q.z, q.w]),
                static=static,
            )
            if why is not None and time.monotonic() - self._last_warning_s > _WARNING_PERIOD_S:
                self._last_warning_s = time.monotonic()
                self._node.get_logger().warning(f"On tf, ignored: {why}.")
        with self._changed:
            self._changed.notify_all()
        if not static:
            for transform in message.transforms:
                self.on_frame(transform.child_frame_id.lstrip("/"))
