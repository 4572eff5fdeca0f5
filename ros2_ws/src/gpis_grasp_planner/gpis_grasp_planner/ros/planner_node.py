"""The node itself, as a plain one; each of its parts is a module of this folder."""

from __future__ import annotations

import contextlib
import threading
from typing import TYPE_CHECKING

import rclpy
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

from gpis_grasp_planner.ros.interfaces import FAREWELL_S, Interfaces, drain, n_threads
from gpis_grasp_planner.ros.parameters import NodeParameters
from gpis_grasp_planner.ros.planning import Planning
from gpis_grasp_planner.ros.text import printable

if TYPE_CHECKING:
    from gpis_grasp_planner.ros.lifecycle_node import GraspPlannerLifecycleNode

NODE_NAME = "grasp_planner"
SPIN_S = 0.2


class GraspPlannerNode(Node):
    """The grasp planner as a node; :func:`spin` runs it."""

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        self.grasp_parameters = NodeParameters(self)
        self._planning = Planning(self, self.grasp_parameters)
        self._interfaces = Interfaces(self, self.grasp_parameters, self._planning)

    def between_spins(self) -> None:
        """Nothing; a lifecycle node makes and takes away its entities here."""

    def close(self) -> None:
        """End the planning process and wait until all requests are answered."""
        self._planning.close()
        self._interfaces.close()
        self._interfaces.wait_until_answered()


def spin(node: GraspPlannerNode | GraspPlannerLifecycleNode, stop: threading.Event) -> None:
    """Run a node until `stop` is set, answer what is open, and destroy it."""
    executor = MultiThreadedExecutor(num_threads=n_threads(node.grasp_parameters))
    executor.add_node(node)
    while rclpy.ok() and not stop.is_set():
        node.between_spins()
        try:
            executor.spin_once(timeout_sec=SPIN_S)
        except Exception as error:
            # Every callback of ours answers for itself; what comes here is a client that went
            # away or rclpy's own services. Neither is a reason to leave the others alone.
            node.get_logger().error(f"In the executor: {printable(repr(error), 400)}")
    node.get_logger().info("Shutting down.")
    # rclpy's shutdown does not wait for running callbacks, whatever its documentation says.
    node.close()
    with contextlib.suppress(Exception):  # a last round for results of goals
        executor.spin_once(timeout_sec=0.05)
    # Nor does it wait for its threads, which would use what is destroyed next.
    drain(executor._executor, FAREWELL_S)
    executor.shutdown()
    node.destroy_node()
