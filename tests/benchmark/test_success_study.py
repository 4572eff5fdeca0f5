"""The studies' command; what a run does is tested in benchmark/test_study_runs.py."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gpis_grasp_benchmark.success_study import shown_command


def test_a_study_from_the_command_to_the_report(benchmark, tmp_path: Path) -> None:
    arguments = [
        "sphere", "--protocol", "strict", "--planners", "random-adaption",
        "--evaluations", "64", "--grasps", "2", "--tried", "1", "--displacements", "1",
        "--set", "verification.duration_s=0.2", "--out", tmp_path / "out",
    ]  # fmt: skip
    answer = benchmark(*arguments)
    assert answer.code == 0, answer.err
    report = (tmp_path / "out" / "report.md").read_text()
    assert "gpis-grasp-benchmark sphere --protocol strict" in report
    assert str(tmp_path) not in report
    [record] = json.loads((tmp_path / "out" / "results.json").read_text())["records"]
    assert record["object_set"] == "shipped parts"
    again = benchmark(*arguments)
    assert "1 of 1 objects are in" in again.err
    assert (tmp_path / "out" / "report.md").read_text() == report


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("teapot",), "Unknown objects teapot"),
        (("--tried", "0"), "--tried is 0"),
        (("--noise-seed", "0"), "--noise-seed is 0"),
        (("--planners", "best"), "Unknown planner 'best'"),
        (("--bullet-objects", "1001"), "1001 random objects"),
        (("--objects", "nowhere"), "nowhere"),
    ],
)
def test_bad_requests_before_any_run(
    benchmark, tmp_path: Path, arguments: tuple[str, ...], word: str
) -> None:
    out = tmp_path / "out"
    answer = benchmark("--protocol", "strict", *arguments, "--out", out)
    assert answer.code == 1
    assert word in answer.err
    assert not out.exists()


def test_directories_of_this_machine_are_not_shown() -> None:
    words = ["--objects", "/home/me/parts", "--out", "docs/study", "a b"]
    assert shown_command(words) == ("gpis-grasp-benchmark --objects parts --out docs/study 'a b'")
