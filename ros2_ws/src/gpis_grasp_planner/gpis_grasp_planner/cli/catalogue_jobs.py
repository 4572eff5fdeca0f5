"""One part after the other in child processes of their own: a crash costs one part, no more.

The parent has loaded the planner, so that a child starts in some 10 ms; it plans one part, keeps
the plan in the store, and says what came of it. What was kept before is not planned again.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.forked_child import ForkedChild
from gpis_grasp_planner.surroundings.place import Place

if TYPE_CHECKING:
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue
    from gpis_grasp_planner.geometry.part import Part
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
    from gpis_grasp_planner.store.grasp_store import GraspStore

_LOOK_S = 0.25
# A part that takes longer than this beside its budget hangs: reading, preparing, trials.
_BESIDE_BUDGET_S = 300.0
_TIMES_BUDGET = 3.0


@dataclass(frozen=True)
class Outcome:
    """What came of one part.

    Attributes
    ----------
    mesh_id : str
    code : str
        Name of the `ErrorCode`.
    message : str
    n_grasps, n_tried, n_held : int
    best_epsilon : float or None
        The largest of the grasps.
    from_store : bool
        It was kept before; nothing was planned.
    kept : bool
        It is in the store now.
    elapsed_s : float
        Of this run.
    mesh_hash : str
        Empty where the mesh could not be read.
    picture : str
        Name of the picture's file; empty where none was drawn.
    """

    mesh_id: str
    code: str
    message: str
    n_grasps: int = 0
    n_tried: int = 0
    n_held: int = 0
    best_epsilon: float | None = None
    from_store: bool = False
    kept: bool = False
    elapsed_s: float = 0.0
    mesh_hash: str = ""
    picture: str = ""

    @property
    def found(self) -> bool:
        """Whether there are grasps."""
        return self.n_grasps > 0

    @property
    def planned(self) -> bool:
        """Whether a search was made in this run."""
        return bool(self.mesh_hash) and not self.from_store

    def as_mapping(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class Work:
    """What is to be done with every part.

    Attributes
    ----------
    planner : GraspPlanner
    store : GraspStore
    catalogue : MeshCatalogue
    request : PlanRequest
    on_lowest : bool
        Whether the part stands on its lowest point; else it floats.
    again : bool
        Whether parts that had no grasp are planned anew.
    pictures : Path or None
        Folder for a picture of each part.
    """

    planner: GraspPlanner
    store: GraspStore
    catalogue: MeshCatalogue
    request: PlanRequest
    on_lowest: bool = False
    again: bool = False
    pictures: Path | None = None

    def do(self, mesh_id: str) -> Outcome:
        """Plan one part, or find that it is planned."""
        began = time.monotonic()
        try:
            part = self.catalogue.load(mesh_id)
            result, from_store, kept = self._planned(part)
        except GraspPlannerError as error:
            spent = time.monotonic() - began
            return Outcome(mesh_id, error.code.name, error.message, elapsed_s=spent)
        return Outcome(
            mesh_id,
            result.code.name,
            result.message,
            n_grasps=len(result.grasps),
            n_tried=sum(grasp.trials is not None for grasp in result.grasps),
            n_held=sum(g.trials is not None and g.trials.held for g in result.grasps),
            best_epsilon=max((grasp.epsilon for grasp in result.grasps), default=None),
            from_store=from_store,
            kept=kept,
            elapsed_s=time.monotonic() - began,
            mesh_hash=result.mesh_hash,
            picture=self._picture(part, result),
        )

    def _planned(self, part: Part) -> tuple[PlanResult, bool, bool]:
        """The result, whether it is from the store, and whether it is there now."""
        from gpis_grasp_planner.store.conditions import Conditions
        from gpis_grasp_planner.store.grasp_store import KEPT_CODES
        from gpis_grasp_planner.store.record import Record

        place = Place()
        if self.on_lowest:
            lowest = [0.0, 0.0, float(part.mesh.bounds[0][2])]
            place = Place.from_mapping({"support": {"point": lowest}})
        planner = self.planner
        conditions = Conditions.of(part, self.request, planner.settings, planner.hand)
        # Plans for other places take no part: a result depends on the part and the request alone.
        found = self.store.find(
            part, conditions, self.request, place, elsewhere=False, failures=not self.again
        )
        if found is not None:
            return found.record.result, True, True
        result = planner.answer(part, self.request, place).result
        kept = result.code in KEPT_CODES and self.store.put(Record(result, conditions))
        return result, False, kept

    def _picture(self, part: Part, result: PlanResult) -> str:
        grasp = result.grasps[0] if result.grasps else result.best_attempt
        if self.pictures is None or grasp is None:
            return ""
        from gpis_grasp_planner.cli.drawing import draw_grasp

        # A name for this very grasp, so that a picture that is there need not be drawn again (5 s).
        of = hashlib.sha256(result.mesh_hash.encode() + grasp.T_object_palm.round(9).tobytes())
        name = f"{part.mesh_id.replace('/', '__')}-{of.hexdigest()[:12]}.png"
        if (self.pictures / name).exists():
            return name
        try:
            draw_grasp(self.pictures / name, part, result, grasp)
        except OSError:
            return ""
        return name


def outcomes(
    work: Work,
    mesh_ids: Sequence[str],
    jobs: int,
    stopped: Callable[[], bool],
    show: Callable[[Sequence[str]], None],
) -> Iterator[Outcome]:
    """Do all parts with `jobs` children at a time; outcomes as they come.

    Parameters
    ----------
    work : Work
    mesh_ids : sequence of str
    jobs : int
        At least 1.
    stopped : callable
        Where it says so, running children are ended and nothing further is begun.
    show : callable
        Called often, with the parts that are being worked on.
    """
    waiting = list(mesh_ids)[::-1]
    running: dict[Connection, tuple[ForkedChild, str, float]] = {}
    limit_s = _BESIDE_BUDGET_S + _TIMES_BUDGET * work.request.time_budget_s

    def begin(mesh_id: str) -> None:
        def serve(connection: Connection) -> None:
            connection.send(work.do(mesh_id))

        child = ForkedChild(serve, forks=True)
        running[child.connection] = (child, mesh_id, time.monotonic())

    try:
        while (waiting or running) and not stopped():
            while waiting and len(running) < jobs:
                begin(waiting.pop())
            show([mesh_id for _, mesh_id, _ in running.values()])
            ready = wait(list(running), _LOOK_S)
            for connection in [connection for connection in running if connection in ready]:
                child, mesh_id, began = running.pop(connection)
                yield _outcome(child, mesh_id, time.monotonic() - began)
            for connection, (child, mesh_id, began) in list(running.items()):
                if time.monotonic() - began > limit_s:
                    del running[connection]
                    child.end()
                    why = f"It was given up after {limit_s:.0f} s. Plan it alone to see why."
                    spent = time.monotonic() - began
                    lost = ErrorCode.PLANNING_PROCESS_LOST.name
                    yield Outcome(mesh_id, lost, why, elapsed_s=spent)
    finally:
        for child, _, _ in running.values():
            child.end()


def _outcome(child: ForkedChild, mesh_id: str, spent_s: float) -> Outcome:
    try:
        outcome: Outcome = child.connection.recv()
    except (EOFError, OSError):
        why = (
            f"Its process ended (code {child.exit_code()}) before it answered. Is there enough "
            "memory? Plan it alone to see why."
        )
        outcome = Outcome(mesh_id, ErrorCode.PLANNING_PROCESS_LOST.name, why, elapsed_s=spent_s)
    child.end()
    return outcome
