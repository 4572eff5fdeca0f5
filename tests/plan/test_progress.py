"""When a running plan tells where it is, by a clock that the test sets."""

from __future__ import annotations

from gpis_grasp_planner.plan.progress import PROGRESS_INTERVAL_S, Monitor, Phase, Progress


class SetClock:
    """A clock that stands still until it is set."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def monitored() -> tuple[Monitor, SetClock, list[Progress]]:
    told: list[Progress] = []
    clock = SetClock()
    return Monitor(10.0, told.append, lambda: False, clock), clock, told


def test_it_tells_some_ten_times_a_second() -> None:
    monitor, clock, told = monitored()
    for step in range(100):
        clock.now = 0.01 * step
        monitor.stopped()
    assert len(told) == round(1.0 / PROGRESS_INTERVAL_S)


def test_a_phase_is_told_at_once() -> None:
    monitor, _, told = monitored()
    with monitor.phase(Phase.SEARCHING):
        assert [progress.phase for progress in told] == [Phase.SEARCHING]


def test_a_grasp_that_held_is_told_at_once_and_only_once() -> None:
    monitor, clock, told = monitored()
    monitor.stopped()
    clock.now = 0.01
    monitor.update(evaluations=5)
    monitor.stopped()
    assert len(told) == 1
    monitor.update(n_held=1)
    monitor.stopped()
    assert [progress.n_held for progress in told] == [0, 1]
    monitor.update(n_held=1)
    monitor.stopped()
    assert len(told) == 2


def test_time_spent_on_reading_counts() -> None:
    clock = SetClock()
    clock.now = 100.0
    monitor = Monitor(10.0, clock=clock, reading_s=4.0)
    assert monitor.elapsed_s == 4.0
    assert monitor.left_s == 6.0
    with monitor.phase(Phase.PREPARING):
        clock.now = 101.0
    assert monitor.phase_s == {Phase.READING: 4.0, Phase.PREPARING: 1.0}
    assert Monitor(10.0, clock=clock).phase_s == {}


def test_half_of_the_budget_is_left_after_reading() -> None:
    clock = SetClock()
    clock.now = 100.0
    monitor = Monitor(10.0, clock=clock, reading_s=30.0)
    assert monitor.elapsed_s == 30.0
    assert monitor.left_s == 5.0
