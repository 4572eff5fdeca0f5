"""What the planning process does with an order: load the mesh, plan, place.

Plans are made by one thread and placed by another; both use what is here.
"""

from __future__ import annotations

import hashlib
import pickle
import threading
import traceback
import zlib
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, MeshError
from gpis_grasp_planner.geometry.catalogue import CatalogueSettings
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.progress import Monitor, Phase, Progress
from gpis_grasp_planner.plan.request import PlanResult
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.ros.worker.messages import (
    DescribeOrder,
    MeshFacts,
    PlaceOrder,
    Plan,
    PlanOrder,
    WorkerError,
)
from gpis_grasp_planner.ros.worker.parts import PartLoader
from gpis_grasp_planner.store.answering import answer_with_store
from gpis_grasp_planner.store.grasp_store import GraspStore
from gpis_grasp_planner.surroundings.place import Place

# Parts and unpacked results; a result remembers the exact quality of grasps of its reserve.
_KEPT = 8
_COMPRESSION = 1


class OrderHandler:
    """Carries out orders; what it prepared for a mesh is kept while the settings stay the same."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._planner = GraspPlanner()
        self._store = GraspStore.of(self._planner.settings.store)
        self._kept: OrderedDict[bytes, tuple[Part, PlanResult]] = OrderedDict()
        # One for each thread.
        self._parts_to_plan, self._parts_to_place = PartLoader(), PartLoader()

    def make_plan(
        self,
        order: PlanOrder,
        on_progress: Callable[[Progress], None],
        should_stop: Callable[[], bool] | None = None,
    ) -> Plan:
        """Load the mesh and plan for the order's place; everything counts against the budget.

        Raises
        ------
        GraspPlannerError
            Of the catalogue or the planner.
        """
        monitor = Monitor(order.request.time_budget_s, on_progress, should_stop)
        load = _load(self._parts_to_plan, order, monitor)
        with monitor.phase(Phase.READING):
            part = load(order.mesh_id)
            place = None if order.place is None else _place(order.place, load)
        known = None
        if order.known:
            known = self._unpacked(order.known)
            if known.mesh_hash != part.mesh.content_hash:
                known = None  # of the file's former version
        planner = self._planner_for(order.settings)
        stored = answer_with_store(
            planner, self._store, part, order.request, place, known=known, monitor=monitor
        )
        answer = stored.answer
        record = b""
        if answer.result.code == ErrorCode.SUCCESS:
            record = zlib.compress(pickle.dumps(answer.result), _COMPRESSION)
            self._keep(record, part, answer.result)
        plan = _plan_of(answer.result, monitor)
        return replace(plan, record=record, from_store=stored.from_store)

    def note_uses(self) -> None:
        """Write down which plans of the store were used; for when the answer has been sent."""
        if self._store is not None:
            self._store.note_uses()

    def from_known(
        self,
        order: PlaceOrder | DescribeOrder,
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> Plan | MeshFacts:
        """Carry out an order that needs no search; raises as :meth:`place`."""
        if isinstance(order, PlaceOrder):
            return self.place(order, on_progress, should_stop)
        monitor = Monitor(order.request.time_budget_s, on_progress, should_stop)
        part = _load(self._parts_to_place, order, monitor)(order.mesh_id)
        x, y, z = map(float, part.mesh.extent)
        return MeshFacts((x, y, z), float(part.mass))

    def place(
        self,
        order: PlaceOrder,
        on_progress: Callable[[Progress], None] | None = None,
        should_stop: Callable[[], bool] | None = None,
    ) -> Plan:
        """Answer a plan for a place, by what is known.

        Raises
        ------
        GraspPlannerError
            Of the catalogue, for a place that is refused, or for a mesh that has changed.
        """
        monitor = Monitor(order.request.time_budget_s, on_progress, should_stop)
        load = _load(self._parts_to_place, order, monitor)
        with monitor.phase(Phase.READING):
            part, result = self._kept_or_loaded(order.plan, load)
            place = _place(order.place, load)
        planner = self._planner_for(order.settings)
        known = planner.known_answer(part, result, order.request, place, monitor)
        plan = _plan_of(known.answer.result, monitor)
        return replace(plan, enough=known.satisfies(order.request))

    def _planner_for(self, settings: Mapping[str, Mapping[str, Any]]) -> GraspPlanner:
        groups = {name: values for name, values in settings.items() if name != "catalogue"}
        wanted = PlannerSettings.from_mapping(groups)
        with self._lock:
            if wanted != self._planner.settings:
                self._planner = GraspPlanner(wanted)
                self._store = GraspStore.of(wanted.store)
            return self._planner

    def _keep(self, record: bytes, part: Part, result: PlanResult) -> None:
        with self._lock:
            self._kept[_key(record)] = part, result
            self._kept.move_to_end(_key(record))
            while len(self._kept) > _KEPT:
                self._kept.popitem(last=False)

    def _kept_or_loaded(self, plan: Plan, load: Callable[[str], Part]) -> tuple[Part, PlanResult]:
        with self._lock:
            kept = self._kept.get(_key(plan.record))
        if kept is None:
            part = load(plan.mesh_id)
            if part.mesh.content_hash != plan.mesh_hash:
                raise MeshError(
                    f"The mesh file of '{plan.mesh_id}' changed while this request was answered: "
                    f"the plan is of {plan.mesh_hash[:16]}..., the file is "
                    f"{part.mesh.content_hash[:16]}.... Call again."
                )
            kept = part, self._unpacked(plan.record)
        self._keep(plan.record, *kept)
        return kept

    def _unpacked(self, record: bytes) -> PlanResult:
        with self._lock:
            kept = self._kept.get(_key(record))
        # Written by this module, in this process or the one before it, and kept by the node.
        return pickle.loads(zlib.decompress(record)) if kept is None else kept[1]


def answer_of(
    make: Callable[..., Plan | MeshFacts], *arguments: Any
) -> Plan | MeshFacts | WorkerError:
    """Make a plan, or an error that can be sent: whatever happens, there is an answer."""
    try:
        return make(*arguments)
    except GraspPlannerError as error:
        return WorkerError(error.code, error.message)
    except MemoryError:
        return WorkerError(
            ErrorCode.OUT_OF_MEMORY,
            "The planning process ran out of memory. Use a mesh with fewer faces, or a "
            "machine with more memory.",
        )
    except Exception as error:
        traceback.print_exc()
        return WorkerError(
            ErrorCode.INTERNAL,
            f"The planner failed unexpectedly ({type(error).__name__}). The traceback is in the "
            "node's output; please report it.",
        )


def _load(
    loader: PartLoader, order: PlanOrder | PlaceOrder | DescribeOrder, monitor: Monitor
) -> Callable[[str], Part]:
    """What loads a part by its mesh ID."""
    return partial(
        loader.load,
        [Path(directory) for directory in order.mesh_directories],
        CatalogueSettings.from_mapping(order.settings["catalogue"]),
        limit_s=order.read_limit_s,
        should_stop=monitor.stopped,
    )


def _place(data: Mapping[str, Any], load: Callable[[str], Part]) -> Place:
    return Place.from_mapping(data, lambda mesh_id: load(mesh_id).mesh)


def _key(record: bytes) -> bytes:
    return hashlib.sha256(record).digest()


def _plan_of(result: PlanResult, monitor: Monitor) -> Plan:
    return Plan(
        code=result.code,
        message=result.message,
        mesh_id=result.mesh_id,
        mesh_hash=result.mesh_hash,
        grasps=result.grasps,
        best_attempt=result.best_attempt,
        notes=result.notes,
        evaluations=result.evaluations,
        funnel=result.funnel,
        elapsed_s=monitor.elapsed_s,
        place=result.place,
        objective=result.objective,
        figures=result.figures,
    )
