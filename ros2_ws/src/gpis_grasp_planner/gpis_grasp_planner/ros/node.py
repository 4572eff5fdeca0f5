"""The node: ``ros2 run gpis_grasp_planner grasp_planner_node``, or this module as a script.

``docs/node.md`` describes topics, service and codes; ``docs/parameters.md`` the parameters.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from pathlib import Path

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.ros.diagnostics import Diagnostics
from gpis_grasp_planner.ros.parameters import NodeParameters
from gpis_grasp_planner.ros.plan_service import SERVICE, PlanGraspService
from gpis_grasp_planner.ros.plan_supply import PlanSupply
from gpis_grasp_planner.ros.pose_source import PoseSource
from gpis_grasp_planner.ros.publishers import GraspPublishers
from gpis_grasp_planner.ros.scene_source import SceneSource
from gpis_grasp_planner.ros.text import printable
from gpis_grasp_planner.ros.worker.watch import PlanningProcess

NODE_NAME = "grasp_planner"
EXIT_CONFIGURATION = 2
SPIN_S = 0.2
# Threads beside those that may wait for a plan: answers from memory, BUSY, poses, parameters.
SPARE_THREADS = 4
FAREWELL_S = 3.0


class GraspPlannerNode(Node):
    """Wires the parts together; each of them is a module of this folder."""

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        self.parameters = NodeParameters(self)
        settings = self.parameters.node
        directories = tuple(map(Path, settings.mesh_directories)) or (
            default_catalogue_directory(),
        )
        catalogue = MeshCatalogue(directories)
        for name, reason in catalogue.refused():
            self.get_logger().warning(f"{ascii(name)[1:-1]} cannot be asked for: {reason}.")
        hand = load_hand()
        self.process = PlanningProcess(lambda text: self.get_logger().warning(text))
        self.process.ensure_started()
        self.poses = PoseSource(self, lambda: self.parameters.node)
        self.supply = PlanSupply(
            self.process,
            directories,
            lambda: self.parameters.node,
            self.parameters.planning_values,
        )
        publishers = GraspPublishers(self, hand)
        scenes = SceneSource(
            lambda: self.parameters.node,
            self.supply.check_mesh_id,
            self.parameters.uses_covariance,
        )
        self.service = PlanGraspService(
            self, hand, lambda: self.parameters.node, self.poses, self.supply, publishers, scenes
        )
        self.diagnostics = Diagnostics(
            self,
            settings.diagnostics_period_s,
            self.process,
            self.supply,
            self.poses,
            self.service,
        )
        self.get_logger().info(
            f"Ready: service {self.resolve_service_name(SERVICE)}, {len(catalogue.ids())} meshes, "
            f"hand {hand.name}, planning process {self.process.pid}."
        )

    def close(self) -> None:
        """End the planning process; requests that wait for it are answered SHUTTING_DOWN."""
        self.process.close()


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; 0 then, 2 where it cannot start as configured."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    insist_on_security()
    node: GraspPlannerNode | None = None
    try:
        # rclpy's own handlers would close the context before waiting requests are answered.
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = GraspPlannerNode()
    except (GraspPlannerError, RCLError, RCLInvalidROSArgsError, UnknownROSArgsError) as error:
        log = rclpy.logging.get_logger(NODE_NAME)
        log.fatal(f"Not started: {printable(error, 1000)}")
        rclpy.try_shutdown()
        return EXIT_CONFIGURATION
    try:
        _spin(node, stop)
    finally:
        rclpy.try_shutdown()
    return 0


def insist_on_security() -> None:
    """Where security is asked for, let a node that cannot have it fail.

    rcl's default with ``ROS_SECURITY_ENABLE=true`` is permissive: without keys, or with a
    middleware that was built without security, the node would start unsecured and say nothing.
    """
    if os.environ.get("ROS_SECURITY_ENABLE", "").lower() == "true":
        os.environ["ROS_SECURITY_STRATEGY"] = "Enforce"


def _spin(node: GraspPlannerNode, stop: threading.Event) -> None:
    waiting = 1 + node.parameters.node.queue_size
    executor = MultiThreadedExecutor(num_threads=waiting + SPARE_THREADS)
    executor.add_node(node)
    while rclpy.ok() and not stop.is_set():
        try:
            executor.spin_once(timeout_sec=SPIN_S)
        except Exception as error:
            # Every callback of ours answers for itself; what comes here is a client that went
            # away or rclpy's own services. Neither is a reason to leave the others alone.
            node.get_logger().error(f"In the executor: {printable(repr(error), 400)}")
    node.get_logger().info("Shutting down.")
    node.close()
    # rclpy's shutdown does not wait for running callbacks, whatever its documentation says.
    deadline = time.monotonic() + FAREWELL_S
    while node.service.n_in_work > 0 and time.monotonic() < deadline:
        time.sleep(0.01)
    executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    node.destroy_node()


if __name__ == "__main__":
    sys.exit(main())
