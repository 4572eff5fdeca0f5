"""A line of the log for an answer looks as rclpy's own."""

from __future__ import annotations

import pytest
import rclpy.logging

from gpis_grasp_planner.ros.answer_log import log_info


def test_a_line_is_as_rclpys_own_and_follows_the_level(capfd: pytest.CaptureFixture[str]) -> None:
    log = rclpy.logging.get_logger("answers")
    log.info("the same")
    log_info(log, "the same")
    log.set_level(rclpy.logging.LoggingSeverity.ERROR)
    log_info(log, "not this one")
    lines = [line for line in capfd.readouterr().err.splitlines() if "answers" in line]
    assert [line.partition("[answers]")[2] for line in lines] == [": the same"] * 2
    assert all(line.startswith("[INFO] [") for line in lines)
