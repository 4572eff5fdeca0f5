"""Plans for requests: from memory where one was made, else from the planning process.

One plan runs at a time; a bounded number of requests waits for its turn; one more is told BUSY
at once. A request that finds its plan in memory never waits.
"""

from __future__ import annotations

import threading
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
        """Look a plan up or make it, for a place where one is given.

        A plan holds at least the node's default number of grasps, so that requests for fewer
        share it. What is known of the mesh is tried first, at any place; only where that is not
        enough a search is made, for this place.

        Raises
        ------
        GraspPlannerError
            BUSY, or why there is no plan.
        """
        settings = self._settings()
        shared = replace(request, n_grasps=max(request.n_grasps, settings.default_n_grasps))
        order = self._order(mesh_id, shared)
        self.cache.size = settings.plan_cache_size
        if (answer := self._from_memory(order, place)) is not None:
            return answer
        with self._entered(settings.queue_size), self._turn:
            # Another request may have made the plan while this one waited.
            return self._from_memory(order, place) or self._made(order, place)

    def place(self, supplied: SuppliedPlan, place: Place, request: PlanRequest) -> SuppliedPlan:
        """The same plan where the part lies now, after a search that was for where it lay.

        Raises
        ------
        GraspPlannerError
            Why there is no answer.
        """
        if supplied.plan.code != ErrorCode.SUCCESS:
            return supplied
        order = self._order(supplied.plan.mesh_id, request)
        return SuppliedPlan(self._placed(order, supplied.plan, place), supplied.from_cache)

    def _from_memory(self, order: PlanOrder, place: Place | None) -> SuppliedPlan | None:
        known = self.cache.get(self._key(order), place)
        if known is None:
            return None
        if not place and known.place is None:
            return SuppliedPlan(known, from_cache=True)
        placed = self._placed(order, known, place or Place())
        return SuppliedPlan(placed, from_cache=True) if placed.enough else None

    def _placed(self, order: PlanOrder, known: Plan, place: Place) -> Plan:
        place_order = PlaceOrder(
            known, order.mesh_directories, place.as_mapping(), order.request, order.settings
        )
        return self._process.place(place_order, self._settings().planning_grace_s)

    def _made(self, order: PlanOrder, place: Place | None) -> SuppliedPlan:
        """A new plan; what is known of the mesh goes with the order."""
        key = self._key(order)
        known = self.cache.get(key, place)
        plan = self._process.plan(
            replace(
                order,
                place=place.as_mapping() if place else None,
                known=b"" if known is None else known.record,
            ),
            self._settings().planning_grace_s,
        )
        if self._key(order) != key:
            note = (
                "The mesh file changed while it was planned on; the plan is of the version with "
                "the given hash and was not kept."
            )
            plan = replace(plan, notes=(*plan.notes, note))
        elif plan.code == ErrorCode.SUCCESS:
            self.cache.put(key, plan)
        return SuppliedPlan(plan, from_cache=False)

    def _order(self, mesh_id: str, request: PlanRequest) -> PlanOrder:
        directories = tuple(map(str, self._directories))
        return PlanOrder(mesh_id, directories, request, self._planning_values())

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
