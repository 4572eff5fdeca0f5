"""What level the node reports."""

from __future__ import annotations

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.ros.diagnostics import level_of


@pytest.mark.parametrize(
    ("runs", "ready", "planning", "code", "level", "words"),
    [
        (True, True, False, ErrorCode.SUCCESS, DiagnosticStatus.OK, "ready"),
        (True, True, True, ErrorCode.SUCCESS, DiagnosticStatus.OK, "planning"),
        (True, True, False, ErrorCode.NO_FEASIBLE_GRASP, DiagnosticStatus.OK, "ready"),
        (True, False, False, ErrorCode.SUCCESS, DiagnosticStatus.OK, "starting"),
        (True, True, True, ErrorCode.BUSY, DiagnosticStatus.WARN, "BUSY"),
        (True, False, False, ErrorCode.PLANNING_PROCESS_LOST, DiagnosticStatus.WARN, "LOST"),
        (True, True, False, ErrorCode.OUT_OF_MEMORY, DiagnosticStatus.WARN, "OUT_OF_MEMORY"),
        (False, False, False, ErrorCode.SUCCESS, DiagnosticStatus.ERROR, "does not run"),
        (False, False, True, ErrorCode.BUSY, DiagnosticStatus.ERROR, "does not run"),
    ],
)
def test_levels(
    runs: bool, ready: bool, planning: bool, code: ErrorCode, level: bytes, words: str
) -> None:
    found, text = level_of(runs=runs, ready=ready, planning=planning, last_code=code)
    assert found == level
    assert words in text
