"""The hand of the last grasp as frames on /tf_static, so that a robot model is shown there.

Static transforms, since they are latched: a viewer that starts later has them as well. Their names
have a prefix, for the frames of the real hand have the names of the URDF already.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from numpy.typing import NDArray
from rclpy.node import Node
from std_msgs.msg import Header

from gpis_grasp_msgs.msg import Grasp
from gpis_grasp_planner.geometry.transforms import inverse, to_position_quat_xyzw
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.ros.qos import LATCHED_QOS
from gpis_grasp_planner.ros.settings import NodeSettings

Array = NDArray[np.float64]


class HandFrames:
    """Publishes where root link and links of the hand are in a grasp.

    Parameters
    ----------
    node : Node
    hand : HandDescription
    settings : callable
        The node's settings at the moment of the call.
    """

    def __init__(
        self, node: Node, hand: HandDescription, settings: Callable[[], NodeSettings]
    ) -> None:
        self._hand, self._settings = hand, settings
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            node.get_logger().warning(
                "The package tf2_msgs is not installed: the hand's frames are not published."
            )
            self._publisher = None
            return
        self._message = TFMessage
        self._publisher = node.create_publisher(TFMessage, "/tf_static", LATCHED_QOS)

    def publish(self, grasp: Grasp) -> None:
        """Publish the frames of a grasp, as many as the parameter `hand_frames` says."""
        settings = self._settings()
        if self._publisher is None or settings.hand_frames == "none":
            return
        frames = hand_frames(self._hand, grasp, settings.hand_frame_prefix)
        if settings.hand_frames == "root":
            del frames[1:]
        self._publisher.publish(self._message(transforms=frames))


def hand_frames(hand: HandDescription, grasp: Grasp, prefix: str) -> list[TransformStamped]:
    """The root link in the frame of the palm's pose, then every other link in its parent's.

    Links that are one body with another one are in the frame of that.

    Parameters
    ----------
    hand : HandDescription
    grasp : Grasp
        A message, closed: its joints are those of `grasp.grasp`.
    prefix : str
        Of the links' names.
    """
    header, palm = grasp.palm_pose.header, grasp.palm_pose.pose
    root = Transform(
        translation=Vector3(x=palm.position.x, y=palm.position.y, z=palm.position.z),
        rotation=palm.orientation,
    )
    names = [prefix + name for name in hand.link_names]
    frames = [TransformStamped(header=header, child_frame_id=names[0], transform=root)]
    T_palm_link = link_transforms(hand, hand.joint_count.of_planner(grasp.grasp.position))[0]
    for link in range(1, hand.n_links):
        parent = int(hand.link_parent[link])
        frames.append(
            TransformStamped(
                header=Header(stamp=header.stamp, frame_id=names[parent]),
                child_frame_id=names[link],
                transform=_transform_message(inverse(T_palm_link[parent]) @ T_palm_link[link]),
            )
        )
    frames += [
        TransformStamped(
            header=Header(stamp=header.stamp, frame_id=prefix + frame.carrier),
            child_frame_id=prefix + frame.name,
            transform=_transform_message(frame.T_carrier_frame),
        )
        for frame in hand.fixed_frames
    ]
    return frames


def _transform_message(T: Array) -> Transform:
    p, q = (values.tolist() for values in to_position_quat_xyzw(T))
    return Transform(
        translation=Vector3(x=p[0], y=p[1], z=p[2]),
        rotation=Quaternion(x=q[0], y=q[1], z=q[2], w=q[3]),
    )
