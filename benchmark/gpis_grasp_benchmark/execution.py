"""Making the runs that are not yet there, several at a time, each on one core."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait

from gpis_grasp_benchmark.runs import Record, Task
from gpis_grasp_benchmark.single_run import RunProcesses
from gpis_grasp_benchmark.store import RunStore
from gpis_grasp_planner.errors import SystemFault
from gpis_grasp_planner.geometry.part import Part


def run_all(
    runs: Sequence[Task],
    parts: Mapping[str, Part],
    store: RunStore,
    cores: int = 1,
    on_done: Callable[[Task, Record | None], None] = lambda _run, _record: None,
    processes: RunProcesses | None = None,
) -> list[str]:
    """Make all runs that the store does not have.

    Parameters
    ----------
    runs : sequence of Task
    parts : mapping
        By object ID.
    store : RunStore
        Each run is in it as soon as it has ended.
    cores : int
        Runs at a time.
    on_done : callable
        Called with each run and its record (None if it failed), in this thread.
    processes : RunProcesses, optional
        What makes a run.

    Returns
    -------
    faults : list of str
        One message per run that failed; such a run is made again next time.

    Raises
    ------
    KeyboardInterrupt
        After ending the runs under way; the finished ones are in the store.
    """
    processes = processes or RunProcesses()
    missing = [run for run in runs if not store.has(run)]
    faults: list[str] = []

    def make(run: Task) -> Record:
        record, document = processes.execute(run, parts[run.object_id])
        store.add(record, document)
        return record

    with ThreadPoolExecutor(max_workers=cores) as pool:
        pending = {pool.submit(make, run): run for run in missing}
        try:
            while pending:
                # A timeout, so that Ctrl-C is heard on every platform.
                for future in wait(pending, timeout=0.5, return_when=FIRST_COMPLETED).done:
                    run = pending.pop(future)
                    try:
                        on_done(run, future.result())
                    except SystemFault as fault:
                        faults.append(str(fault))
                        on_done(run, None)
        except BaseException:
            for future in pending:
                future.cancel()
            processes.stop()
            raise
    return faults
