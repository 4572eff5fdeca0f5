"""The line of progress: on a terminal only, ticking by itself."""

from __future__ import annotations

import io
import os
import re
import select
import sys
import threading
from types import SimpleNamespace

import pytest

from gpis_grasp_planner.cli import status_line
from gpis_grasp_planner.cli.status_line import StatusLine
from gpis_grasp_planner.plan.progress import Phase, Progress


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch):
    """Stderr as a terminal; a function that reads from its other side until a pattern is there."""
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "w") as stream:
        # Not sys.stderr itself, which pytest puts back between fixture and test.
        monkeypatch.setattr(status_line, "sys", SimpleNamespace(stderr=stream))
        monkeypatch.setenv("TERM", "xterm")

        def read_until(pattern: str, times: int = 1) -> str:
            shown = ""
            while len(set(re.findall(pattern, shown))) < times:
                ready, _, _ = select.select([ours], [], [], 30.0)
                assert ready, f"{pattern} is not in {shown!r}"
                shown += os.read(ours, 4096).decode()
            return shown

        yield read_until
    os.close(ours)


def test_it_ticks_while_nothing_is_reported_and_is_gone_in_the_end(terminal) -> None:
    with StatusLine("loading") as status:
        terminal(r"loading: \d\.\d s", times=3)
        status.enter("reading")
        terminal("reading: ")
        status.show(Progress(Phase.SEARCHING, 0.4, 5.0, 96, 0.1234, 3))
        shown = terminal("of 5 s, 96 attempts, best epsilon 0.1234")
        assert "\n" not in shown
        status.note("a note")
        terminal(r"\r\x1b\[Ka note\r\n")
    assert terminal(r"\r\x1b\[K$").endswith("\r\x1b[K")


def test_phases_of_the_planner_are_shown_by_their_names() -> None:
    status = StatusLine("loading")
    status.show(Progress(Phase.TRYING, 1.0, 5.0, 3, n_tried=4, n_held=1))
    assert status.text().startswith("trying: 1.")  # the clock of the budget
    assert status.text().endswith(" of 5 s, 3 attempts, 1 of 4 held in physics")
    status.enter("drawing")
    assert status.text().startswith("drawing: 0.")


def test_without_a_terminal_there_are_notes_only(capfd: pytest.CaptureFixture[str]) -> None:
    before = threading.active_count()
    with StatusLine("loading") as status:
        assert threading.active_count() == before
        status.show(Progress(Phase.SEARCHING, 0.4, 5.0, 96, 0.1234, 3))
        status.note("a note")
    assert capfd.readouterr().err == "a note\n"


def test_a_narrow_terminal_is_not_wrapped(terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "20")
    with StatusLine("a phase with a long name"):
        assert "a phase with a long" in terminal("a phase with")


def test_a_note_is_written_where_stderr_is_no_file(monkeypatch: pytest.MonkeyPatch) -> None:
    text = io.StringIO()
    monkeypatch.setattr(sys, "stderr", text)
    with StatusLine("loading") as status:
        status.note("compiling")
    assert text.getvalue() == "compiling\n"
