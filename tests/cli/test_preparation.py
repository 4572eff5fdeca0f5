"""'compiling' is said when something is compiled, and only then."""

from __future__ import annotations

import numba
import pytest

from gpis_grasp_planner.cli.preparation import COMPILING, ready_to_plan, when_compiling


def test_where_nothing_is_compiled_nothing_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from gpis_grasp_planner.plan import warm_up

    ready = numba.njit(lambda x: x + 1)
    ready(1)

    def load(planners: list[str]) -> None:
        assert ready(1) == 2

    monkeypatch.setattr(warm_up, "warm_up", load)
    ready_to_plan("dual")
    assert capsys.readouterr().err == ""


def test_what_is_compiled_is_said_once_and_at_its_beginning(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from gpis_grasp_planner.plan import warm_up

    new = numba.njit(lambda x: x + 2)
    newer = numba.njit(lambda x: x + 3)

    def compile_two(planners: list[str]) -> None:
        assert new(1) == 3
        assert newer(1.0) == 4.0

    monkeypatch.setattr(warm_up, "warm_up", compile_two)
    ready_to_plan("dual")
    assert capsys.readouterr().err == COMPILING + "\n"


def test_the_listener_goes_with_its_block() -> None:
    heard: list[str] = []
    with when_compiling(lambda: heard.append("compiling")):
        pass
    numba.njit(lambda x: x + 4)(1)
    assert heard == []
