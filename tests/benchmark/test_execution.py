from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from gpis_grasp_benchmark.execution import run_all
from gpis_grasp_benchmark.store import RunStore
from gpis_grasp_planner.errors import SystemFault


class FakeProcesses:
    """Makes records at once; fails, or waits to be stopped, where it is told to."""

    def __init__(self, make_record, failing=(), hanging=()) -> None:
        self._make_record = make_record
        self._failing = set(failing)
        self._hanging = set(hanging)
        self._stopped = threading.Event()
        self._lock = threading.Lock()
        self.made: list[int] = []
        self.at_once = 0
        self.most_at_once = 0

    def execute(self, run, part):
        with self._lock:
            self.at_once += 1
            self.most_at_once = max(self.at_once, self.most_at_once)
        try:
            if run.seed in self._hanging:
                self._stopped.wait(30.0)
                raise SystemFault("stopped")
            time.sleep(0.01)
            if run.seed in self._failing:
                raise SystemFault(f"run {run.seed} died")
        finally:
            with self._lock:
                self.at_once -= 1
        self.made.append(run.seed)
        return self._make_record([0.1], seed=run.seed), part

    def stop(self) -> None:
        self._stopped.set()


PARTS = {"mug": "the part"}


def test_all_runs_are_made_once(tmp_path: Path, make_run, make_record) -> None:
    runs = [make_run(seed=s) for s in range(6)]
    seen = []
    fake = FakeProcesses(make_record)
    faults = run_all(runs, PARTS, RunStore(tmp_path), 3, lambda r, _: seen.append(r.seed), fake)
    assert faults == []
    assert sorted(fake.made) == sorted(seen) == list(range(6))
    assert 1 <= fake.most_at_once <= 3
    store = RunStore(tmp_path)
    assert all(store.has(run) for run in runs)
    assert store.document_path(store.select(runs)[0]).read_text() == "the part"
    again = FakeProcesses(make_record)
    run_all(runs, PARTS, store, 3, processes=again)
    assert again.made == []


def test_one_core_makes_one_run_at_a_time(tmp_path: Path, make_run, make_record) -> None:
    fake = FakeProcesses(make_record)
    run_all([make_run(seed=s) for s in range(4)], PARTS, RunStore(tmp_path), 1, processes=fake)
    assert fake.most_at_once == 1


def test_a_run_that_dies_ends_no_other_and_is_made_again(
    tmp_path: Path, make_run, make_record
) -> None:
    runs = [make_run(seed=s) for s in range(4)]
    outcomes = {}
    fake = FakeProcesses(make_record, failing=[2])
    faults = run_all(
        runs,
        PARTS,
        RunStore(tmp_path),
        1,
        lambda run, record: outcomes.__setitem__(run.seed, record is not None),
        fake,
    )
    assert faults == ["run 2 died"]
    assert outcomes == {0: True, 1: True, 2: False, 3: True}
    again = FakeProcesses(make_record)
    assert run_all(runs, PARTS, RunStore(tmp_path), 1, processes=again) == []
    assert again.made == [2]


def test_an_interruption_keeps_what_is_finished_and_ends_the_rest(
    tmp_path: Path, make_run, make_record
) -> None:
    runs = [make_run(seed=s) for s in range(8)]
    fake = FakeProcesses(make_record, hanging=[3])

    def interrupt(run, record) -> None:
        if run.seed == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_all(runs, PARTS, RunStore(tmp_path), 1, interrupt, fake)
    assert fake._stopped.is_set()
    store = RunStore(tmp_path)
    assert [store.has(run) for run in runs[:4]] == [True, True, True, False]
    again = FakeProcesses(make_record)
    assert run_all(runs, PARTS, store, 1, processes=again) == []
    assert sorted(again.made + fake.made) == list(range(8))
