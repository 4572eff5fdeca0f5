"""Plans for requests: from memory where one was made, else from the planning process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gpis_grasp_planner.errors import ErrorCode, PlanningError
from gpis_grasp_planner.geometry.catalogue import ID_PATTERN, CatalogueSettings, MeshCatalogue
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.mesh_source import check_directories, fingerprint
from gpis_grasp_planner.ros.plan_cache import PlanCache, PlanKey, plan_key
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.work_queue import Lane, WorkQueue
from gpis_grasp_planner.ros.worker.messages import (
    DescribeOrder,
    MeshFacts,
    PlaceOrder,
    Plan,
    PlanOrder,
)
from gpis_grasp_planner.ros.worker.watch import PlanningProcess
from gpis_grasp_planner.surroundings.place import Place

_MOST_FACTS = 10_000


@dataclass(frozen=True, eq=False)
class DeliveredPlan:
    """A plan and whether it was made for an earlier request, in memory or the grasp store."""

    plan: Plan
    from_cache: bool


class PlanSource:
    """Makes plans and keeps them. Thread-safe.

    A request that finds its plan in memory, as it is, never waits. Everything else has its turn
    in the one bounded queue.

    Parameters
    ----------
    process : PlanningProcess
    queue : WorkQueue
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
        queue: WorkQueue,
        directories: tuple[Path, ...],
        settings: Callable[[], NodeSettings],
        planning_values: Callable[[], dict[str, dict[str, Any]]],
    ) -> None:
        self._process = process
        self._queue = queue
        self._directories = directories
        self._settings = settings
        self._planning_values = planning_values
        self.cache = PlanCache(settings().plan_cache_size)
        self._facts: dict[PlanKey, MeshFacts] = {}
        self._seen_ids: set[str] = set()
        self._catalogue: tuple[object, CatalogueSettings] = (None, CatalogueSettings())

    def check_mesh_id(self, mesh_id: str) -> None:
        """Refuse an ID that is not allowed or has no file, without opening or parsing one.

        Raises
        ------
        RequestError
            INVALID_MESH_ID or UNKNOWN_MESH; INVALID_SETTING where a directory is gone.
        """
        if ID_PATTERN.fullmatch(mesh_id) is None or self._fingerprint(mesh_id) is None:
            check_directories(self._directories)
            MeshCatalogue(self._directories, self._catalogue_settings()).load(mesh_id)
        if len(self._seen_ids) >= _MOST_FACTS:
            self._seen_ids.clear()
        self._seen_ids.add(mesh_id)

    def version(self, mesh_id: str) -> str | None:
        """Another text once a file of this mesh ID has changed; None where there is none."""
        return self._fingerprint(mesh_id)

    def reserve(self, mesh_id: str, seed: int, call: Call) -> None:
        """Keep a place in the queue for a request, before anything else is looked at (some us).

        Not for one whose plan may be in memory, which does not need one, nor for a mesh ID that
        was not asked for before: it may be wrong, and that is to be said.

        Raises
        ------
        SystemFault
            BUSY.
        """
        if mesh_id in self._seen_ids and not self.cache.may_have(mesh_id, seed):
            self._queue.reserve(call)

    def release(self, call: Call) -> None:
        """Give up what was reserved for a request; it may have been used."""
        self._queue.release(call)

    def plan(
        self, mesh_id: str, request: PlanRequest, call: Call, place: Place | None = None
    ) -> DeliveredPlan:
        """Look a plan up or make it, for a place where one is given.

        A plan holds at least the node's default number of grasps, so that requests for fewer
        share it. What is known of the mesh is tried first, at any place; only where that is not
        enough a search is made, for this place, in what is left of the time.

        Raises
        ------
        GraspPlannerError
            BUSY, or why there is no plan.
        """
        if place is not None and not self.depends(request, place):
            place = None
        order = self._order(mesh_id, request)
        self.cache.size = self._settings().plan_cache_size
        spent_s = 0.0
        if (known := self._known(order, place)) is not None:
            if place is None and known.place is None:
                return DeliveredPlan(known, from_cache=True)
            with self._queue.turn(Lane.KNOWN, call):
                placed = self._placed(order, known, _at(place), call)
            if placed.enough or placed.code == ErrorCode.CANCELLED:
                return DeliveredPlan(placed, from_cache=True)
            spent_s += placed.elapsed_s
        with self._queue.turn(Lane.SEARCH, call):
            # Another request may have made the plan while this one waited.
            newer = self._known(order, place)
            if newer is not None and newer is not known:
                if place is None and newer.place is None:
                    return DeliveredPlan(newer, from_cache=True)
                with self._queue.turn(Lane.KNOWN, call):
                    placed = self._placed(order, newer, _at(place), call)
                if placed.enough or placed.code == ErrorCode.CANCELLED:
                    return DeliveredPlan(placed, from_cache=True)
                spent_s += placed.elapsed_s
            made = self._made(order, place, newer, call, spent_s)
            return DeliveredPlan(made, from_cache=made.from_store)

    def place(
        self, delivered: DeliveredPlan, place: Place, request: PlanRequest, call: Call
    ) -> DeliveredPlan:
        """The same plan where the part lies now, after a search that was for where it lay.

        Raises
        ------
        GraspPlannerError
            Why there is no answer.
        """
        if delivered.plan.code != ErrorCode.SUCCESS:
            return delivered
        order = self._order(delivered.plan.mesh_id, request)
        with self._queue.turn(Lane.KNOWN, call):
            placed = self._placed(order, delivered.plan, place, call)
        return DeliveredPlan(placed, delivered.from_cache)

    def known(
        self, mesh_id: str, request: PlanRequest, call: Call, place: Place | None = None
    ) -> DeliveredPlan:
        """What is in memory for a request, for a place where one is given; nothing is searched.

        Raises
        ------
        PlanningError
            NOTHING_KNOWN.
        GraspPlannerError
            BUSY, or why there is no answer.
        """
        if place is not None and not self.depends(request, place):
            place = None
        order = self._order(mesh_id, request)
        known = self._known(order, place)
        if known is None:
            raise PlanningError(
                f"No plan of '{mesh_id}' for this request is in memory. Ask plan_grasp for one.",
                ErrorCode.NOTHING_KNOWN,
            )
        if place is None and known.place is None:
            return DeliveredPlan(known, from_cache=True)
        with self._queue.turn(Lane.KNOWN, call):
            return DeliveredPlan(self._placed(order, known, _at(place), call), from_cache=True)

    def depends(self, request: PlanRequest, place: Place) -> bool:
        """Whether a plan for this place is another one than in free space, wherever that is."""
        own = self._planning_values()["constraints"]["names"]
        return bool(place) or request.depends_on_pose or bool(own)

    def facts(self, mesh_id: str, call: Call, *, measure: bool) -> MeshFacts | None:
        """Size and mass of a mesh: as read before, or read now where that is wanted.

        Raises
        ------
        GraspPlannerError
            Of the catalogue, or BUSY.
        """
        order = self._order(mesh_id, PlanRequest())
        key = self._key(order)
        if key not in self._facts and measure:
            with self._queue.turn(Lane.KNOWN, call):
                facts = self._process.describe(
                    DescribeOrder(
                        mesh_id,
                        order.mesh_directories,
                        order.request,
                        order.settings,
                        order.read_limit_s,
                    ),
                    call,
                )
            if len(self._facts) >= _MOST_FACTS:
                self._facts.clear()
            self._facts[key] = facts
        return self._facts.get(key)

    def listed(self) -> tuple[list[str], list[tuple[str, str]]]:
        """IDs of the catalogue, and files that cannot be offered, each with the reason."""
        check_directories(self._directories)
        catalogue = MeshCatalogue(self._directories, self._catalogue_settings())
        return catalogue.ids(), catalogue.refused()

    def _known(self, order: PlanOrder, place: Place | None) -> Plan | None:
        return self.cache.get(self._key(order), place)

    def _placed(self, order: PlanOrder, known: Plan, place: Place, call: Call) -> Plan:
        place_order = PlaceOrder(
            known,
            order.mesh_directories,
            place.as_mapping(),
            order.request,
            order.settings,
            order.read_limit_s,
        )
        # With the record of what was placed: it may have to be placed again, for a newer pose.
        return replace(self._process.carry_out(place_order, call), record=known.record)

    def _made(
        self, order: PlanOrder, place: Place | None, known: Plan | None, call: Call, spent_s: float
    ) -> Plan:
        """A new plan; what is known of the mesh goes with the order.

        What placing has cost is taken off the budget.
        """
        key = self._key(order)
        plan = self._process.carry_out(
            replace(
                order,
                request=order.request.again(spent_s),
                place=None if place is None else place.as_mapping(),
                known=b"" if known is None else known.record,
            ),
            call,
        )
        if self._key(order) != key:
            note = (
                "The mesh file changed while it was planned on; the plan is of the version with "
                "the given hash and was not kept."
            )
            plan = replace(plan, notes=(*plan.notes, note))
        elif plan.code == ErrorCode.SUCCESS:
            self.cache.put(key, plan)
        return plan

    def _order(self, mesh_id: str, request: PlanRequest) -> PlanOrder:
        settings = self._settings()
        shared = replace(request, n_grasps=max(request.n_grasps, settings.default_n_grasps))
        return PlanOrder(
            mesh_id,
            tuple(map(str, self._directories)),
            shared,
            self._planning_values(),
            read_limit_s=settings.mesh_read_limit_s,
        )

    def _key(self, order: PlanOrder) -> PlanKey:
        return plan_key(order, self._fingerprint(order.mesh_id) or "")

    def _fingerprint(self, mesh_id: str) -> str | None:
        limit = self._catalogue_settings().max_file_bytes
        return fingerprint(self._directories, mesh_id, limit)

    def _catalogue_settings(self) -> CatalogueSettings:
        values = self._planning_values()["catalogue"]
        known, settings = self._catalogue
        if known is not values:
            settings = CatalogueSettings.from_mapping(values)
            self._catalogue = values, settings
        return settings


def _at(place: Place | None) -> Place:
    return Place() if place is None else place
