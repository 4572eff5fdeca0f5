"""All that others on the network see of the node: topics, services, the action, diagnostics."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rclpy.action import ActionServer
from rclpy.node import Node

from gpis_grasp_planner.ros.answering import GraspAnswering
from gpis_grasp_planner.ros.catalogue_service import CatalogueServices
from gpis_grasp_planner.ros.diagnostics import Diagnostics
from gpis_grasp_planner.ros.estimator_frames import EstimatorFrames
from gpis_grasp_planner.ros.parameters import NodeParameters
from gpis_grasp_planner.ros.plan_action import PlanGraspAction
from gpis_grasp_planner.ros.plan_service import SERVICE, PlanGraspService
from gpis_grasp_planner.ros.planning import Planning
from gpis_grasp_planner.ros.pose_source import PoseSource
from gpis_grasp_planner.ros.publishers import GraspPublishers
from gpis_grasp_planner.ros.request_reader import RequestReader
from gpis_grasp_planner.ros.scene_source import SceneSource
from gpis_grasp_planner.ros.tf_listener import TfListener
from gpis_grasp_planner.ros.time_jumps import TimeJumps
from gpis_grasp_planner.ros.tracking import Tracking
from gpis_grasp_planner.ros.work_queue import Lane

# Threads beside those that may wait or work: refusals, answers from memory, BUSY.
SPARE_THREADS = 4
FAREWELL_S = 3.0
_KINDS = ("timer", "service", "client", "subscription", "publisher")


class Interfaces:
    """Makes a node's entities, and takes them away again.

    Parameters
    ----------
    node : Node
    parameters : NodeParameters
    planning : Planning
    """

    def __init__(self, node: Node, parameters: NodeParameters, planning: Planning) -> None:
        self._node = node
        self._threads = ThreadPoolExecutor(n_threads(parameters), "request")
        before = _entities(node)
        self._requests = RequestReader(node, self._threads)
        self._jumps: TimeJumps | None = None
        try:
            self._make(node, parameters, planning)
        except Exception:
            self._take_note(before)
            self.destroy()
            raise
        self._take_note(before)
        self._requests.start()
        node.get_logger().info(
            f"Ready: service {node.resolve_service_name(SERVICE)}, "
            f"{len(planning.catalogue.ids())} meshes, hand {planning.hand.name}, planning process "
            f"{planning.supervisor.pid}."
        )

    def _make(self, node: Node, parameters: NodeParameters, planning: Planning) -> None:
        plans, hand = planning.plans, planning.hand
        poses = PoseSource(
            node,
            lambda: parameters.node,
            EstimatorFrames(planning.catalogue.sidecar, plans.version),
        )
        frames = TfListener(node, lambda: parameters.node)
        poses.listen_to(frames)
        self._jumps = TimeJumps(node, poses.forget, frames.tree.forget_moving)
        scenes = SceneSource(
            lambda: parameters.node,
            plans.check_mesh_id,
            parameters.uses_covariance,
            frames.transform,
            parameters.arm_model,
        )
        self.answering = GraspAnswering(
            node.get_logger(),
            hand,
            lambda: parameters.node,
            poses,
            plans,
            GraspPublishers(node, hand, planning.plain_file, lambda: parameters.node),
            scenes,
            frames.transform,
        )
        PlanGraspService(node, self.answering, self._requests)
        PlanGraspAction(node, self.answering, lambda: parameters.node)
        CatalogueServices(node, plans, poses, self.answering, self._requests)
        tracking = Tracking(lambda: parameters.node, self.answering, self._threads)
        poses.on_estimate = tracking.on_estimate
        Diagnostics(
            node,
            parameters.node.diagnostics_period_s,
            planning.supervisor,
            planning.queue,
            plans,
            poses,
            self.answering,
        )

    def _take_note(self, before: dict[str, set[Any]]) -> None:
        now = _entities(self._node)
        self._made = {kind: now[kind] - before[kind] for kind in before}

    def wait_until_answered(self) -> None:
        """Until no request is in work, 3 s at most."""
        deadline = time.monotonic() + FAREWELL_S
        while self.answering.n_in_work > 0 and time.monotonic() < deadline:
            time.sleep(0.01)

    def close(self) -> None:
        """Take no more work, and wait until answers are sent, 3 s at most.

        The entities go with the node, or by :meth:`destroy`.
        """
        self._requests.close()
        if self._jumps is not None:
            self._jumps.close()
            self._jumps = None
        drain(self._threads, FAREWELL_S)

    def destroy(self) -> None:
        """Take everything off the network; the node stays."""
        self.close()
        for waitable in self._made["waitable"]:  # others go with their publishers and so on
            if isinstance(waitable, ActionServer):
                waitable.destroy()
        for kind in _KINDS:
            for entity in self._made[kind]:
                getattr(self._node, f"destroy_{kind}")(entity)


def drain(threads: ThreadPoolExecutor, limit_s: float) -> None:
    """Take no more work, and wait until what threads have begun is done, `limit_s` at most."""
    waiting = threading.Thread(target=threads.shutdown, daemon=True)
    waiting.start()
    waiting.join(limit_s)


def n_threads(parameters: NodeParameters) -> int:
    """Threads so that some are free however many requests wait: queue_size is read-only."""
    return parameters.node.queue_size + 2 * len(Lane) + SPARE_THREADS


def _entities(node: Node) -> dict[str, set[Any]]:
    made = {kind: set(getattr(node, f"{kind}s")) for kind in _KINDS}
    return made | {"waitable": set(node.waitables)}
