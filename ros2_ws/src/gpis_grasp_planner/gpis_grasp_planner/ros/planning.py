"""What the node plans with: catalogue, hand, planning process, queue, and the plans in memory."""

from __future__ import annotations

from pathlib import Path

from rclpy.node import Node

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.ros.parameters import NodeParameters
from gpis_grasp_planner.ros.plan_source import PlanSource
from gpis_grasp_planner.ros.work_queue import WorkQueue
from gpis_grasp_planner.ros.worker.supervisor import WorkerSupervisor, WorkLimits
from gpis_grasp_planner.ros.worker.watch import PlanningProcess


class Planning:
    """Starts the planning process; has nothing that others on the network see.

    Parameters
    ----------
    node : Node
        For its log.
    parameters : NodeParameters

    Raises
    ------
    GraspPlannerError
        Where the configuration does not allow it.
    """

    def __init__(self, node: Node, parameters: NodeParameters) -> None:
        self._node, self._parameters = node, parameters
        directories = tuple(map(Path, parameters.node.mesh_directories)) or (
            default_catalogue_directory(),
        )
        self._directories = directories
        self.catalogue = MeshCatalogue(directories)
        for name, reason in self.catalogue.refused():
            node.get_logger().warning(f"{ascii(name)[1:-1]} cannot be asked for: {reason}.")
        self.hand = load_hand(parameters.hand_model)
        self.supervisor = WorkerSupervisor(self._limits, node.get_logger().warning)
        self.supervisor.ensure_started()
        self.queue = WorkQueue(lambda: parameters.node.queue_size)
        self.plans = PlanSource(
            PlanningProcess(self.supervisor),
            self.queue,
            directories,
            lambda: parameters.node,
            parameters.planning_values,
        )

    def plain_file(self, mesh_id: str) -> tuple[Path, float] | None:
        """As :meth:`MeshCatalogue.plain_file`, in the default unit of this moment."""
        settings = self._parameters.group("catalogue")
        assert isinstance(settings, CatalogueSettings)
        return MeshCatalogue(self._directories, settings).plain_file(mesh_id)

    def close(self) -> None:
        """End the planning process; requests that wait for it are answered SHUTTING_DOWN."""
        self.supervisor.close()

    def renewed(self) -> Planning:
        """Another one with the plans of this one, which is closed."""
        self.close()
        planning = Planning(self._node, self._parameters)
        planning.plans.cache = self.plans.cache
        return planning

    def _limits(self) -> WorkLimits:
        settings = self._parameters.node
        return WorkLimits(
            grace_s=settings.planning_grace_s,
            preparation_s=settings.mesh_preparation_limit_s,
            retries=settings.retries_of_lost_orders,
            memory_bytes=1e6 * settings.worker_memory_limit_mb,
            nice=settings.worker_nice,
        )
