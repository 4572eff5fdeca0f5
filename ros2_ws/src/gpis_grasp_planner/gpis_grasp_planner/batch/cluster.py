"""The parts of a catalogue on the workers of a Dask scheduler; the one module that knows Dask.

This process reads the parts, looks what is kept, and keeps what comes back; a worker does nothing
but plan. A part travels as its arrays, under a hash of everything that its plan depends on; the
plan that comes back says for what it was made, and that is compared. Where a worker is lost, the
scheduler gives its parts to others.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import multiprocessing
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib.metadata import version
from typing import Any, Self

import dask
from distributed import Client, Future, Worker, as_completed
from distributed.scheduler import KilledWorker

from gpis_grasp_planner.batch.catalogue_work import CatalogueWork
from gpis_grasp_planner.batch.outcome import Outcome
from gpis_grasp_planner.batch.part_child import PartChild
from gpis_grasp_planner.batch.part_planning import PartPlanning
from gpis_grasp_planner.errors import GraspPlannerError, SystemFault
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.warm_up import load_compiled, make_ready
from gpis_grasp_planner.store.conditions import planner_version
from gpis_grasp_planner.store.record import Record

_CONNECT_S = 10.0
_FIRST_WORKER_S = 30.0
_LOOK_S = 0.02
_COUNT_WORKERS_S = 1.0
# Parts that are read before a worker is free for them.
_READ_AHEAD = 4
_NUMERIC = ("numpy", "scipy", "numba", "pybullet")


# On the worker.


@dataclass(frozen=True)
class _Unfit:
    """Said by a worker that must not plan: another version, or one that cannot fork."""

    message: str


def _other(there: dict[str, str], wanted: dict[str, str]) -> str:
    return ", ".join(f"{k} {v}, not {wanted[k]}" for k, v in there.items() if v != wanted[k])


@cache
def versions() -> dict[str, str]:
    """What a plan's figures depend on beside its conditions: the planner and its libraries."""
    return {"planner": planner_version()} | {name: version(name) for name in _NUMERIC}


_lock = threading.Lock()
_planners: dict[str, GraspPlanner] = {}


def _planner_of(planning: PartPlanning) -> GraspPlanner:
    """The planner of the last settings; with its compiled code loaded, which children inherit."""
    with _lock:
        if not make_ready(planning.request.planner):
            load_compiled()
        settings = repr(planning.settings)
        if settings not in _planners:
            _planners.clear()
            _planners[settings] = GraspPlanner(planning.settings)
        return _planners[settings]


def _answer(planning: PartPlanning, planner: GraspPlanner, part: Part) -> Record | Exception:
    try:
        return planning.plan(planner, part)
    except GraspPlannerError as error:
        return error


def plan_on_worker(
    planning: PartPlanning, part: Part, wanted: dict[str, str]
) -> Record | Exception | _Unfit:
    """Plan one part in a child of the worker; the plan, or the error that ended it."""
    here = versions()
    if here != wanted:
        return _Unfit(f"has {_other(here, wanted)}. Install the same versions on every machine")
    if multiprocessing.current_process().daemon:
        return _Unfit(
            "may not start processes. Start it by 'gpis-grasp worker', or by "
            "'dask worker --no-nanny'"
        )
    try:
        child = PartChild(partial(_answer, planning, _planner_of(planning), part), planning.limit_s)
        answer: Record | Exception = child.answer()
    except GraspPlannerError as error:
        return error
    return answer


def serve_worker(address: str, jobs: int, on_ready: Callable[[str], None]) -> None:
    """Plan for a scheduler, `jobs` parts at a time, until SIGINT, SIGTERM or the scheduler's end.

    `on_ready` is called with the worker's own address once the scheduler knows it.

    Raises
    ------
    SystemFault
        Where there is no scheduler.
    """
    load_compiled()
    _be_quiet()

    async def serve() -> None:
        async with Worker(
            address, nthreads=jobs, memory_limit=0, death_timeout=_CONNECT_S, dashboard=False
        ) as worker:
            ended = asyncio.ensure_future(worker.finished())
            loop = asyncio.get_running_loop()
            for number in (signal.SIGINT, signal.SIGTERM):
                loop.add_signal_handler(number, ended.cancel)
            on_ready(worker.address)
            with contextlib.suppress(asyncio.CancelledError):
                await ended
            await worker.close(timeout=1, executor_wait=False)

    try:
        asyncio.run(serve())
    except (TimeoutError, OSError, ValueError) as error:
        raise _no_scheduler(address, error) from None
    # What is being planned is planned elsewhere: no waiting for its thread.
    os._exit(0)


# Where the command was given.


@dataclass(eq=False)
class _Asked:
    """A part that is to be planned, and others of the same content that wait for its plan."""

    key: str
    part: Part
    began: float
    same: list[str]


class Cluster:
    """Sends the parts of a catalogue to a scheduler and keeps what comes back; a context manager.

    Parameters
    ----------
    work : CatalogueWork
    address : str
        Of the scheduler, such as 'tcp://10.0.0.1:8786'.

    Raises
    ------
    SystemFault
        Where there is no scheduler, no worker, or a worker of another version.
    """

    def __init__(self, work: CatalogueWork, address: str) -> None:
        _be_quiet()
        self._work, self._address = work, address
        self._asked: dict[str, _Asked] = {}
        self._ready: deque[str] = deque()
        self._counted = -_COUNT_WORKERS_S
        self._workers: dict[str, int] = {}
        try:
            self._client = Client(address, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:  # asyncio's TimeoutError is an OSError
            raise _no_scheduler(address, error) from None
        try:
            self._check_workers()
        except BaseException as error:
            self._client.close()
            if isinstance(error, OSError):
                raise _lost(address) from None
            raise
        self._finished = as_completed(loop=self._client.loop, with_results=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(Exception):  # of a scheduler that is gone
            self._client.cancel(list(self._asked), force=True)
        with contextlib.suppress(Exception):
            self._client.close(timeout=2)

    def outcomes(
        self,
        mesh_ids: Sequence[str],
        stopped: Callable[[], bool],
        show: Callable[[Sequence[str]], None],
    ) -> Iterator[Outcome]:
        """Do all parts; outcomes as they come.

        Parameters
        ----------
        mesh_ids : sequence of str
        stopped : callable
            Where it says so nothing further is begun or waited for.
        show : callable
            Called often, with how many workers there are.

        Raises
        ------
        SystemFault
            Where the scheduler is lost, or a worker may not plan. What came before is kept.
        """
        waiting = deque(mesh_ids)
        while (waiting or self._asked) and not stopped():
            if self._client.status != "running":
                raise _lost(self._address)
            self._count_workers()
            show([f"{len(self._workers)} workers"])
            read = bool(waiting) and len(self._ready) < _READ_AHEAD
            if read:
                outcome = self._read(waiting.popleft())
                if outcome is not None:
                    yield outcome
            self._send()
            came = self._finished.next_batch(block=False)
            for future, answer in came:
                asked = self._asked.pop(future.key)
                waiting.extendleft(asked.same)
                outcome = self._kept(future, answer, asked)
                if outcome is None:
                    waiting.append(asked.part.mesh_id)
                else:
                    yield outcome
            if not read and not came:
                time.sleep(_LOOK_S)

    def _read(self, mesh_id: str) -> Outcome | None:
        """Make a part ready to be sent; its outcome where that is known already."""
        began = time.monotonic()
        work = self._work
        try:
            part = work.catalogue.load(mesh_id)
            outcome = work.found(part, began)
            key = f"plan-{work.planning.content_hash(part, work.planner.hand)}"
        except GraspPlannerError as error:
            return Outcome.failed(mesh_id, error, time.monotonic() - began)
        if outcome is not None:
            return outcome
        if key in self._asked:
            self._asked[key].same.append(mesh_id)
            return None
        self._asked[key] = _Asked(key, part, began, [])
        self._ready.append(key)
        return None

    def _send(self) -> None:
        """Send as many parts as can be planned at a time.

        Where a worker is lost, Dask counts that against all parts that wait there: none do.
        """
        sent = len(self._asked) - len(self._ready)
        while self._ready and sent < sum(self._workers.values()):
            asked = self._asked[self._ready.popleft()]
            with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}):
                future = self._client.submit(
                    plan_on_worker, self._work.planning, bare_part(asked.part), versions(),
                    key=asked.key,
                )  # fmt: skip
            self._finished.add(future)
            sent += 1

    def _kept(self, future: Future[Any], answer: Any, asked: _Asked) -> Outcome | None:
        """Keep what a worker answered; None where the part has to be sent anew."""
        part, spent = asked.part, time.monotonic() - asked.began
        if future.status == "cancelled":  # by somebody else
            return None
        if future.status == "error":
            error = answer[1]
            if not isinstance(error, KilledWorker):
                raise SystemFault(
                    f"A worker of {self._address} cannot plan ({type(error).__name__}: {error}). "
                    "Is gpis_grasp_planner of this version installed there?"
                )
            n, last = error.allowed_failures + 1, error.last_worker.address
            why = (
                f"{n} workers were lost while they planned it, the last one {last}. Is there "
                "enough memory? Plan it alone to see why."
            )
            return Outcome.lost(part.mesh_id, why, spent)
        if isinstance(answer, _Unfit):
            raise SystemFault(f"A worker of {self._address} {answer.message}.")
        if isinstance(answer, GraspPlannerError):
            return Outcome.failed(part.mesh_id, answer, spent)
        if answer.conditions != self._work.planning.conditions(part, self._work.planner.hand):
            raise SystemFault(
                f"A worker planned '{part.mesh_id}' for other conditions than were asked for. Do "
                "files that settings name (hands, arms) have the same content on every machine?"
            )
        # The time of planning, without that of waiting for a worker.
        return self._work.keep(part, answer, time.monotonic() - answer.result.elapsed_s)

    def _check_workers(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=_FIRST_WORKER_S)
        except TimeoutError:
            raise SystemFault(
                f"The scheduler {self._address} has no worker. Start one with "
                f"'gpis-grasp worker {self._address}'."
            ) from None
        try:
            found = self._client.run(versions)
        except ImportError as error:
            raise SystemFault(
                f"A worker of {self._address} cannot plan ({error}). Install the same version of "
                "gpis_grasp_planner on every machine."
            ) from None
        for worker, there in found.items():
            if there != versions():
                raise SystemFault(
                    f"Worker {worker} has {_other(there, versions())}. Install the same versions "
                    "on every machine."
                )

    def _count_workers(self) -> None:
        now = time.monotonic()
        if now - self._counted < _COUNT_WORKERS_S:
            return
        self._counted = now
        with contextlib.suppress(OSError):  # of a scheduler that is lost the status tells
            self._workers = self._client.nthreads()


def bare_part(part: Part) -> Part:
    """A part without what its meshes have computed: that is made anew of what arrives."""
    simplified = part.simplified
    return replace(
        part,
        mesh=TriangleMesh(part.mesh.vertices, part.mesh.faces),
        simplified=simplified and TriangleMesh(simplified.vertices, simplified.faces),
    )


def _lost(address: str) -> SystemFault:
    return SystemFault(
        f"The scheduler {address} was lost. What was planned is kept; the same command goes on "
        "when it is there again."
    )


def _no_scheduler(address: str, error: Exception) -> SystemFault:
    why = " ".join(str(error).split()) or type(error).__name__
    return SystemFault(
        f"There is no scheduler at {address} ({why}). Start one with 'dask scheduler', and give "
        "the address that it prints, such as tcp://10.0.0.1:8786."
    )


def _be_quiet() -> None:
    """Say what is wrong here alone: Dask logs each lost connection with a traceback."""
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
