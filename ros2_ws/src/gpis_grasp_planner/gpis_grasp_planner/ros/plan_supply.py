"""Plans for requests: from memory where one was made, else from the planning process.

One plan runs at a time; a bounded number of requests waits for its turn; one more is told BUSY
at once. A request that finds its plan in memory never waits.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gpis_grasp_planner.errors import ErrorCode, SystemFault
from gpis_grasp_planner.geometry.catalogue import ID_PATTERN, CatalogueSettings, MeshCatalogue
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.mesh_source import fingerprint
from gpis_grasp_planner.ros.plan_cache import PlanCache, plan_key
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.worker.messages import PlaceOrder, Plan, PlanOrder
from gpis_grasp_planner.ros.worker.watch import PlanningProcess
from gpis_grasp_planner.surroundings.place import Place


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

    def plan(self, mesh_id: str, request: PlanRequest, place: Place | None = None) -> SuppliedPlan:
        """Look a plan up or make it.

        A plan holds at least the node's default number of grasps, so that requests for fewer
        share it. It is good for every place; where one is given, the trials in physics begin with
        what is clear there and draw from its covariance.

        Raises
        ------
        GraspPlannerError
            BUSY, or why there is no plan.
        """
        settings = self._settings()
        shared = replace(request, n_grasps=max(request.n_grasps, settings.default_n_grasps))
        present = place.as_mapping() if place else None
        order = replace(self._order(mesh_id, shared), present=present)
        self.cache.size = settings.plan_cache_size
        known = self.cache.get(self._key(order))
        if known is not None:
            return SuppliedPlan(known, from_cache=True)
        with self._entered(settings.queue_size), self._turn:
            return self._plan_in_turn(order, settings.planning_grace_s)

    def place(self, supplied: SuppliedPlan, place: Place, request: PlanRequest) -> SuppliedPlan:
        """The plan for one place of its part; where that leaves nothing, another search.

        What is searched with the surroundings known is for this place alone and is not kept.

        Raises
        ------
        GraspPlannerError
            BUSY where the search would have to wait for too many others, or why there is no answer.
        """
        start = time.monotonic()
        settings, plan = self._settings(), supplied.plan
        if plan.code != ErrorCode.SUCCESS:
            return supplied
        order = PlaceOrder(
            plan,
            tuple(map(str, self._directories)),
            place.as_mapping(),
            request.n_grasps,
            request.time_budget_s,
            self._planning_values(),
        )
        placed = self._process.place(order, settings.planning_grace_s)
        if placed.code != ErrorCode.ALL_GRASPS_BLOCKED:
            return SuppliedPlan(placed, supplied.from_cache)
        spent_s = time.monotonic() - start + (0.0 if supplied.from_cache else plan.elapsed_s)
        again = replace(
            self._order(plan.mesh_id, request.again(spent_s)),
            place=order.place,
            blocked=placed.blocked,
        )
        with self._entered(settings.queue_size), self._turn:
            searched = self._process.plan(again, settings.planning_grace_s)
        return SuppliedPlan(searched, from_cache=False)

    def _order(self, mesh_id: str, request: PlanRequest) -> PlanOrder:
        directories = tuple(map(str, self._directories))
        return PlanOrder(mesh_id, directories, request, self._planning_values())

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

    @contextmanager
    def _entered(self, queue_size: int) -> Iterator[None]:
        """Be one of the requests that are planned or wait; BUSY if there are too many."""
        with self._count_lock:
            if self._n_requests > queue_size:
                raise SystemFault(
                    f"A plan is running and {self._n_requests - 1} requests wait; the limit is "
                    f"{queue_size} (parameter queue_size). Call again later.",
                    ErrorCode.BUSY,
                )
            self._n_requests += 1
        try:
            yield
        finally:
            with self._count_lock:
                self._n_requests -= 1

    def _key(self, order: PlanOrder) -> str:
        return plan_key(order, self._fingerprint(order.mesh_id) or "")

    def _fingerprint(self, mesh_id: str) -> str | None:
        limit = self._catalogue_settings().max_file_bytes
        return fingerprint(self._directories, mesh_id, limit)

    def _catalogue_settings(self) -> CatalogueSettings:
        return CatalogueSettings.from_mapping(self._planning_values()["catalogue"])
