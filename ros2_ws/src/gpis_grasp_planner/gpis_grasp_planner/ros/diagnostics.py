"""The node's state on /diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.ros.answering import GraspAnswering
from gpis_grasp_planner.ros.plan_source import PlanSource
from gpis_grasp_planner.ros.pose_source import PoseSource
from gpis_grasp_planner.ros.steady_timer import steady_timer
from gpis_grasp_planner.ros.work_queue import WorkQueue
from gpis_grasp_planner.ros.worker.supervisor import WorkerSupervisor


class Diagnostics:
    """Publishes periodically; also revives a planning process that was lost while idle."""

    def __init__(
        self,
        node: Node,
        period_s: float,
        supervisor: WorkerSupervisor,
        queue: WorkQueue,
        plans: PlanSource,
        poses: PoseSource,
        answering: GraspAnswering,
    ) -> None:
        self._node = node
        self._supervisor = supervisor
        self._queue = queue
        self._plans = plans
        self._poses = poses
        self._answering = answering
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady_timer(node, period_s, self._on_timer)

    def _on_timer(self) -> None:
        try:
            self._supervisor.revive()
            message = DiagnosticArray(status=[self._status()])
            message.header.stamp = self._node.get_clock().now().to_msg()
            self._publisher.publish(message)
        except Exception as error:
            self._node.get_logger().error(f"Diagnostics failed: {error!r}")

    def _status(self) -> DiagnosticStatus:
        level, text = self._level()
        values = {
            "planning process": str(self._supervisor.pid),
            "starts of the planning process": str(self._supervisor.starts),
            "memory of the planning process (MB)": f"{self._supervisor.memory_bytes / 1e6:.0f}",
            "orders worked on": str(self._queue.n_running),
            "requests waiting": str(self._queue.n_waiting),
            "requests in work": str(self._answering.n_in_work),
            "plans in memory": str(len(self._plans.cache)),
            "parts with a pose estimate": self._poses.names(),
            "answers": str(self._answering.n_answers),
            "last answer": self._answering.last_code.name,
        }
        return DiagnosticStatus(
            level=level,
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: planner",
            hardware_id="gpis_grasp_planner",
            message=text,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )

    def _level(self) -> tuple[bytes, str]:
        supervisor = self._supervisor
        return level_of(
            runs=supervisor.pid is not None,
            ready=supervisor.ready,
            planning=self._queue.n_running > 0,
            last_code=self._answering.last_code,
        )


def level_of(*, runs: bool, ready: bool, planning: bool, last_code: ErrorCode) -> tuple[bytes, str]:
    """ERROR where nothing can be planned, WARN where the last request met a fault, else OK."""
    if not runs:
        return DiagnosticStatus.ERROR, "the planning process does not run"
    if last_code >= ErrorCode.BUSY:
        return DiagnosticStatus.WARN, f"last answer: {last_code.name}"
    if not ready:
        return DiagnosticStatus.OK, "ready; the planning process is starting"
    return DiagnosticStatus.OK, "planning" if planning else "ready"
