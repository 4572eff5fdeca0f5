"""Plans for requests: from memory where one was made, else from the planning process.

One plan runs at a time; a bounded number of requests waits for its turn; one more is told BUSY
at once. A request that finds its plan in memory never waits.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gpis_grasp_planner.errors import ErrorCode, SystemFault
from gpis_grasp_planner.geometry.catalogue import ID_PATTERN, CatalogueSettings, MeshCatalogue
from gpis_grasp_planner.planning.request import PlanRequest
from gpis_grasp_planner.ros.mesh_source import fingerprint
from gpis_grasp_planner.ros.plan_cache import PlanCache, plan_key
from gpis_grasp_planner.ros.planned import Plan, PlanOrder
from gpis_grasp_planner.ros.planning_process import PlanningProcess
from gpis_grasp_planner.ros.settings import NodeSettings


@dataclass(frozen=True, eq=False)
class SuppliedPlan:
    """A plan and whether it was made for an earlier request."""

    plan: Plan
    from_cache: bool


class PlanSupply:
    """Makes plans and keeps them. Thread-safe.

    Parameters
    ----------
    process : PlanningProcess
    directories : tuple of Path
        Of the mesh catalogue.
    settings : callable
        The node's settings at the moment of the call.
    planning_values : callable
        Values by group of all that decides a plan, "catalogue" among them.
    """

    def __init__(
        self,
        process: PlanningProcess,
        directories: tuple[Path, ...],
        settings: Callable[[], NodeSettings],
        planning_values: Callable[[], dict[str, dict[str, Any]]],
    ) -> None:
        self._process = process
        self._directories = directories
        self._settings = settings
        self._planning_values = planning_values
        self._turn = threading.Lock()
        self._count_lock = threading.Lock()
        self._n_requests = 0
        self.cache = PlanCache(settings().plan_cache_size)

    @property
    def n_requests(self) -> int:
        """Requests that are planned or wait for their turn."""
        return self._n_requests

    def check_mesh_id(self, mesh_id: str) -> None:
        """Refuse an ID that is not allowed or has no file, without opening or parsing one.

        Raises
        ------
        RequestError
            INVALID_MESH_ID or UNKNOWN_MESH.
        """
        if ID_PATTERN.fullmatch(mesh_id) is None or self._fingerprint(mesh_id) is None:
            MeshCatalogue(self._directories, self._catalogue_settings()).load(mesh_id)

    def plan(self, mesh_id: str, request: PlanRequest) -> SuppliedPlan:
        """Look a plan up or make it.

        A plan holds at least the node's default number of grasps, so that requests for fewer
        share it.

        Raises
        ------
        GraspPlannerError
            BUSY, or why there is no plan.
        """
        settings = self._settings()
        shared = replace(request, n_grasps=max(request.n_grasps, settings.default_n_grasps))
        order = PlanOrder(
            mesh_id, tuple(map(str, self._directories)), shared, self._planning_values()
        )
        self.cache.size = settings.plan_cache_size
        known = self.cache.get(self._key(order))
        if known is not None:
            return SuppliedPlan(known, from_cache=True)
        self._enter(settings.queue_size)
        try:
            with self._turn:
                return self._plan_in_turn(order, settings.planning_grace_s)
        finally:
            with self._count_lock:
                self._n_requests -= 1

    def _plan_in_turn(self, order: PlanOrder, grace_s: float) -> SuppliedPlan:
        # Another request may have made the plan, or the file may have changed, while this waited.
        key = self._key(order)
        known = self.cache.get(key)
        if known is not None:
            return SuppliedPlan(known, from_cache=True)
        plan = self._process.plan(order, grace_s)
        if self._key(order) != key:
            note = (
                "The mesh file changed while it was planned on; the plan is of the version with "
                "the given hash and was not kept."
            )
            plan = replace(plan, notes=(*plan.notes, note))
        elif plan.code == ErrorCode.SUCCESS:
            self.cache.put(key, plan)
        return SuppliedPlan(plan, from_cache=False)

    def _enter(self, queue_size: int) -> None:
        with self._count_lock:
            if self._n_requests > queue_size:
                raise SystemFault(
                    f"A plan is running and {self._n_requests - 1} requests wait; the limit is "
                    f"{queue_size} (parameter queue_size). Call again later.",
                    ErrorCode.BUSY,
                )
            self._n_requests += 1

    def _key(self, order: PlanOrder) -> str:
        return plan_key(order, self._fingerprint(order.mesh_id) or "")

    def _fingerprint(self, mesh_id: str) -> str | None:
        limit = self._catalogue_settings().max_file_bytes
        return fingerprint(self._directories, mesh_id, limit)

    def _catalogue_settings(self) -> CatalogueSettings:
        return CatalogueSettings.from_mapping(self._planning_values()["catalogue"])
