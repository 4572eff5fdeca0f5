"""Processes that write into a grasp store until they are killed, and what must be there then."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from gpis_grasp_planner.forked_child import ForkedChild
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.store.conditions import Conditions
from gpis_grasp_planner.store.grasp_store import GraspStore
from gpis_grasp_planner.store.record import Record


def record_of(part, result: PlanResult, **changes) -> Record:
    """A record of a result whose request differs by `changes`, such as another seed."""
    request = replace(result.request, **changes)
    conditions = Conditions.of(part, request, PlannerSettings(), load_hand(result.hand))
    return Record(replace(result, request=request), conditions)


def kill_a_writer(path: Path, part, result: PlanResult, first_seed: int, delay_s: float) -> int:
    """SIGKILL a process that stores plan after plan; how many it was told are on the disk.

    Parameters
    ----------
    path : Path
        Of the store.
    part : Part
    result : PlanResult
    first_seed : int
        Its plans have the seeds from here on, so that each is a row of its own.
    delay_s : float [s]
        From the first plan that is acknowledged to the kill.
    """

    def write(connection: Connection) -> None:
        store = GraspStore(path, wait_s=60.0)
        seed = first_seed
        while True:
            if not store.put(record_of(part, result, seed=seed)):
                os._exit(3)
            connection.send(seed)
            seed += 1

    acknowledged = 0
    with ForkedChild(write) as child:
        child.connection.recv()
        acknowledged = 1
        time.sleep(delay_s)
        os.kill(child.pid, signal.SIGKILL)
        try:
            while True:
                child.connection.recv()
                acknowledged += 1
        except (EOFError, OSError):
            pass
        assert child.exit_code() == -signal.SIGKILL
    return acknowledged


def killed_writers(path: Path, part, result, n: int, rng: np.random.Generator) -> tuple[int, int]:
    """Kill `n` writers one after the other: acknowledged plans, and plans that are there.

    Raises
    ------
    AssertionError
        Where an acknowledged plan is missing or damaged, or the file is not sound.
    """
    seed, total = 0, 0
    expected: set[int] = set()
    store = GraspStore(path)
    for _ in range(n):
        told = kill_a_writer(path, part, result, seed, rng.uniform(0.0, 0.05))
        expected |= set(range(seed, seed + told))
        total += told
        seed += told + 10
        assert store.database.faults() == []
    there = set()
    for _, record in store.records():
        assert isinstance(record, Record), record
        there.add(record.result.request.seed)
    assert expected <= there, sorted(expected - there)
    assert not list(path.parent.glob("*.damaged-*"))
    return total, len(there)


def small_plan(part) -> PlanResult:
    """A plan of a few attempts, with a reserve."""
    from gpis_grasp_planner.plan.planner import GraspPlanner

    request = PlanRequest(time_budget_s=60.0, max_evaluations=128, n_grasps=3)
    return GraspPlanner().answer(part, request).result
