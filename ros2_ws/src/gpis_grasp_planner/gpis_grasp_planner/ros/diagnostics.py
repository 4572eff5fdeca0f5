"""The node's state on /diagnostics."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.ros.plan_service import PlanGraspService
from gpis_grasp_planner.ros.plan_supply import PlanSupply
from gpis_grasp_planner.ros.pose_source import PoseSource
from gpis_grasp_planner.ros.worker.watch import PlanningProcess


class Diagnostics:
    """Publishes periodically; also revives a planning process that was lost while idle."""

    def __init__(
        self,
        node: Node,
        period_s: float,
        process: PlanningProcess,
        supply: PlanSupply,
        poses: PoseSource,
        service: PlanGraspService,
    ) -> None:
        self._node = node
        self._process = process
        self._supply = supply
        self._poses = poses
        self._service = service
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_timer(period_s, self._on_timer)

    def _on_timer(self) -> None:
        try:
            self._process.revive()
            message = DiagnosticArray(status=[self._status()])
            message.header.stamp = self._node.get_clock().now().to_msg()
            self._publisher.publish(message)
        except Exception as error:
            self._node.get_logger().error(f"Diagnostics failed: {error!r}")

    def _status(self) -> DiagnosticStatus:
        level, text = DiagnosticStatus.OK, "ready"
        code = self._service.last_code
        if self._process.pid is None:
            level, text = DiagnosticStatus.ERROR, "the planning process does not run"
        elif self._process.busy:
            text = "planning"
        elif not self._process.ready:
            text = "ready; the planning process is starting"
        elif code >= ErrorCode.BUSY:
            level, text = DiagnosticStatus.WARN, f"last answer: {code.name}"
        values = {
            "planning process": str(self._process.pid),
            "starts of the planning process": str(self._process.starts),
            "requests in work": str(self._supply.n_requests),
            "plans in memory": str(len(self._supply.cache)),
            "parts with a pose estimate": str(self._poses.count()),
            "answers": str(self._service.n_answers),
            "last answer": code.name,
        }
        return DiagnosticStatus(
            level=level,
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: planner",
            hardware_id="gpis_grasp_planner",
            message=text,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
