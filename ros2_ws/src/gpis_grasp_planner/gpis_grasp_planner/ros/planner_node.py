"""The node itself: wires the parts together; each of them is a module of this folder."""

from __future__ import annotations

import contextlib
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import rclpy
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.ros.answering import GraspAnswering
from gpis_grasp_planner.ros.catalogue_service import CatalogueServices
from gpis_grasp_planner.ros.diagnostics import Diagnostics
from gpis_grasp_planner.ros.estimator_frames import EstimatorFrames
from gpis_grasp_planner.ros.parameters import NodeParameters
from gpis_grasp_planner.ros.plan_action import PlanGraspAction
from gpis_grasp_planner.ros.plan_service import SERVICE, PlanGraspService
from gpis_grasp_planner.ros.plan_source import PlanSource
from gpis_grasp_planner.ros.pose_source import PoseSource
from gpis_grasp_planner.ros.publishers import GraspPublishers
from gpis_grasp_planner.ros.scene_source import SceneSource
from gpis_grasp_planner.ros.text import printable
from gpis_grasp_planner.ros.tf_listener import TfListener
from gpis_grasp_planner.ros.tracking import Tracking
from gpis_grasp_planner.ros.work_queue import Lane, WorkQueue
from gpis_grasp_planner.ros.worker.supervisor import WorkerSupervisor, WorkLimits
from gpis_grasp_planner.ros.worker.watch import PlanningProcess

NODE_NAME = "grasp_planner"
SPIN_S = 0.2
# Threads beside those that may wait or work: refusals, answers from memory, BUSY.
SPARE_THREADS = 4
FAREWELL_S = 3.0


class GraspPlannerNode(Node):
    """The grasp planner as a node; :func:`spin` runs it."""

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
        hand = load_hand(self.parameters.hand_model)
        self.supervisor = WorkerSupervisor(
            self._work_limits, lambda text: self.get_logger().warning(text)
        )
        self.supervisor.ensure_started()
        self.poses = PoseSource(
            self, lambda: self.parameters.node, EstimatorFrames(catalogue.sidecar)
        )
        self.frames = TfListener(self, lambda: self.parameters.node)
        self.poses.listen_to(self.frames)
        self.queue = WorkQueue(lambda: self.parameters.node.queue_size)
        self.plans = PlanSource(
            PlanningProcess(self.supervisor),
            self.queue,
            directories,
            lambda: self.parameters.node,
            self.parameters.planning_values,
        )
        publishers = GraspPublishers(self, hand)
        scenes = SceneSource(
            lambda: self.parameters.node,
            self.plans.check_mesh_id,
            self.parameters.uses_covariance,
            self.frames.transform,
        )
        self.answering = GraspAnswering(
            self.get_logger(),
            hand,
            lambda: self.parameters.node,
            self.poses,
            self.plans,
            publishers,
            scenes,
            self.frames.transform,
        )
        self.threads = ThreadPoolExecutor(self.n_threads, "request")
        self.service = PlanGraspService(self, self.answering, self.threads)
        self.action = PlanGraspAction(self, self.answering, lambda: self.parameters.node)
        self.catalogue_services = CatalogueServices(
            self, self.plans, self.poses, self.answering, self.threads
        )
        tracking = Tracking(lambda: self.parameters.node, self.answering, self.threads)
        self.poses.on_estimate = tracking.on_estimate
        self.diagnostics = Diagnostics(
            self,
            settings.diagnostics_period_s,
            self.supervisor,
            self.queue,
            self.plans,
            self.poses,
            self.answering,
        )
        self.get_logger().info(
            f"Ready: service {self.resolve_service_name(SERVICE)}, {len(catalogue.ids())} meshes, "
            f"hand {hand.name}, planning process {self.supervisor.pid}."
        )

    @property
    def n_threads(self) -> int:
        """Threads so that some are free however many requests wait: queue_size is read-only."""
        return self.parameters.node.queue_size + 2 * len(Lane) + SPARE_THREADS

    def close(self) -> None:
        """End the planning process; requests that wait for it are answered SHUTTING_DOWN."""
        self.supervisor.close()
        self.threads.shutdown(wait=False)

    def _work_limits(self) -> WorkLimits:
        settings = self.parameters.node
        return WorkLimits(
            grace_s=settings.planning_grace_s,
            preparation_s=settings.mesh_preparation_limit_s,
            retries=settings.retries_of_lost_orders,
            memory_bytes=1e6 * settings.worker_memory_limit_mb,
            nice=settings.worker_nice,
        )


def spin(node: GraspPlannerNode, stop: threading.Event) -> None:
    """Run a node until `stop` is set, answer what is open, and destroy it."""
    executor = MultiThreadedExecutor(num_threads=node.n_threads)
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
    while node.answering.n_in_work > 0 and time.monotonic() < deadline:
        time.sleep(0.01)
    with contextlib.suppress(Exception):  # a last round for results of goals
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    node.destroy_node()
