"""'compiling' is said when something is compiled, and only then."""

from __future__ import annotations

import time

import numba
import pytest

from gpis_grasp_planner import compiled
from gpis_grasp_planner.cli.preparation import COMPILING, ready_to_plan, timed_reading
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.plan import warm_up


def test_where_code_is_on_disk_nothing_is_done(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(compiled, "is_ready", lambda planner: planner == "dual")
    monkeypatch.setattr(warm_up, "warm_up", None)
    ready_to_plan("dual")
    assert capsys.readouterr().err == ""


def test_where_nothing_is_compiled_nothing_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ready = numba.njit(lambda x: x + 1)
    ready(1)

    def load(planners: list[str]) -> None:
        assert ready(1) == 2

    monkeypatch.setattr(compiled, "is_ready", lambda planner: False)
    monkeypatch.setattr(warm_up, "warm_up", load)
    ready_to_plan("dual")
    assert capsys.readouterr().err == ""


def test_what_is_compiled_is_said_once_and_at_its_beginning(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    new = numba.njit(lambda x: x + 2)
    newer = numba.njit(lambda x: x + 3)

    def compile_two(planners: list[str]) -> None:
        assert planners == ["dual"]
        assert new(1) == 3
        assert newer(1.0) == 4.0

    monkeypatch.setattr(compiled, "is_ready", lambda planner: False)
    monkeypatch.setattr(warm_up, "warm_up", compile_two)
    ready_to_plan("dual")
    assert capsys.readouterr().err == COMPILING + "\n"


def test_an_unknown_planner_is_refused_before_anything_is_compiled(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(warm_up, "warm_up", None)
    with pytest.raises(RequestError, match="nonsense"):
        ready_to_plan("nonsense")


def test_reading_is_timed_without_the_loading_before_it() -> None:
    with timed_reading() as reading:
        begun = time.monotonic()
        time.sleep(0.02)
        least = time.monotonic() - begun
    assert least <= reading.seconds
