"""The benchmark command with real runs of a few grasps, stopped and taken up again."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gpis_grasp_benchmark import command
from gpis_grasp_planner.cli import main

PATH = os.pathsep.join(
    str(Path(module.__file__).parents[n]) for module, n in ((command, 1), (main, 2))
)
QUICK = (
    "sphere", "--planners", "random,random-adaption", "--evaluations", "64",
    "--time", "120", "--grasps", "4", "--no-pictures",
)  # fmt: skip


def keys(out: Path) -> list[str]:
    return [json.loads(line)["key"] for line in (out / "runs.jsonl").read_text().splitlines()]


def test_an_interrupted_benchmark_goes_on_where_it_stopped(benchmark, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = [*QUICK, "--seeds", "2", "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "gpis_grasp_benchmark.command", *arguments],
        env={**os.environ, "PYTHONPATH": PATH},
        stderr=subprocess.PIPE,
        text=True,
        # What runs in the background ignores Ctrl-C and so would its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    while process.poll() is None and not (out / "runs.jsonl").exists():
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 130, err
    assert "the same command goes on" in err
    assert "Traceback" not in err
    finished = keys(out)
    assert 1 <= len(finished) < 4

    answer = benchmark(*arguments)
    assert answer.code == 0, answer.err
    assert f"{len(finished)} of 4 runs are in {out} already" in answer.err
    assert keys(out)[: len(finished)] == finished
    assert len(set(keys(out))) == len(keys(out)) == 4

    report = (out / "report.md").read_text()
    assert "equal evaluations: 64 per run" in report
    assert "gpis-grasp-benchmark sphere" in report
    assert (out / "plots/sphere.png").stat().st_size > 1000
    with (out / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(r["planner"], r["seed"]) for r in rows] == [
        ("random", "0"),
        ("random", "1"),
        ("random-adaption", "0"),
        ("random-adaption", "1"),
    ]
    assert {r["n_grasps"] for r in rows} == {"4"}
    assert {(r["friction_finger"], r["friction_palm"]) for r in rows} == {("0.4", "0.3")}
    results = json.loads((out / "results.json").read_text())
    assert all(r["settings"]["scene"]["cone_edges"] == 8 for r in results)

    # Everything is there: nothing is planned, the report is the same.
    again = benchmark(*arguments)
    assert again.code == 0
    assert "4 of 4 runs" in again.err
    assert len(keys(out)) == 4
    assert (out / "report.md").read_text() == report


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("--planners", "hpp,best"), "Unknown planner 'best'"),
        (("--seeds", "0"), "--seeds is 0"),
        (("--cores", "0"), "--cores is 0"),
        (("--time", "0"), "time budget"),
        (("--friction", "0.3", "-1"), "friction of the palm"),
        (("--facts", "nowhere.yaml"), "nowhere.yaml"),
        (("--objects", "nowhere"), "nowhere"),
        (("teapot",), "teapot"),
    ],
)
def test_bad_requests_before_any_run(
    benchmark, tmp_path: Path, arguments: tuple[str, ...], word: str
) -> None:
    out = tmp_path / "out"
    answer = benchmark(*arguments, "--out", out)
    assert answer.code == 1
    assert word in answer.err
    assert not out.exists()
