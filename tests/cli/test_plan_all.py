"""The command 'plan-all': all of a tree, whatever ends it, the same by any number of jobs."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time

import pytest
import trimesh
from clusters import part_under_way
from terminal_sessions import PROGRAM, environment, in_pipe, in_terminal

from gpis_grasp_planner.batch.outcome import Outcome
from gpis_grasp_planner.cli.plan_all import progress_text
from gpis_grasp_planner.plan.document import document_of
from gpis_grasp_planner.store.grasp_store import GraspStore

QUICK = ("--evaluations", "96", "--grasps", "3", "--verify", "none")


@pytest.fixture
def tree(tmp_path):
    """Three boxes, one of them in a folder and in millimetres, and a file that is no mesh."""
    folder = tmp_path / "parts"
    (folder / "small").mkdir(parents=True)
    trimesh.creation.box((0.05, 0.06, 0.09)).export(folder / "box.stl")
    trimesh.creation.box((0.04, 0.05, 0.07)).export(folder / "brick.stl")
    trimesh.creation.box((40.0, 50.0, 60.0)).export(folder / "small" / "cube.stl")
    (folder / "small" / "cube.yaml").write_text("unit: mm\n")
    (folder / "bad.stl").write_text("no mesh\n")
    return folder


@pytest.fixture
def path(tmp_path, monkeypatch):
    path = tmp_path / "grasps.sqlite"
    monkeypatch.setenv("GPIS_GRASP_STORE", str(path))
    return path


def parts_of(answer):
    return {part["mesh_id"]: part for part in json.loads(answer.out)["parts"]}


def documents(path):
    """Plans by part, without what differs by the clock."""
    found = {}
    for entry, record in GraspStore(path).records():
        document = document_of(record.result)
        for field in ("elapsed_s", "phase_s", "convergence"):
            del document[field]
        found[entry.mesh_id] = document
    return found


def test_every_part_is_planned_or_has_a_reason(gpis_grasp, tree, path, tmp_path):
    report = tmp_path / "report"
    answer = gpis_grasp(
        "plan-all", tree, *QUICK, "--json", "-", "--report", report, "--no-pictures"
    )
    assert answer.code == 1
    parts = parts_of(answer)
    assert set(parts) == {"bad", "box", "brick", "small/cube"}
    assert parts["bad"]["code"] == "MESH_UNREADABLE"
    good = [parts[name] for name in ("box", "brick", "small/cube")]
    assert all(part["code"] == "SUCCESS" and part["kept"] for part in good)
    assert {entry.mesh_id for entry in GraspStore(path).entries()} == set(parts) - {"bad"}
    page = (report / "index.html").read_text()
    assert "MESH_UNREADABLE: bad.stl" in page
    assert page.count("<tr") == 1 + len(parts)


def test_nothing_is_planned_twice_and_another_place_is_another_plan(gpis_grasp, tree, path):
    (tree / "bad.stl").unlink()
    free = parts_of(gpis_grasp("plan-all", tree, *QUICK, "--json", "-"))
    again = parts_of(gpis_grasp("plan-all", tree, *QUICK, "--json", "-"))
    assert not any(part["from_store"] for part in free.values())
    assert all(part["from_store"] for part in again.values())
    table = parts_of(gpis_grasp("plan-all", tree, *QUICK, "--json", "-", "--support", "lowest"))
    assert not any(part["from_store"] for part in table.values())
    trimesh.creation.box((0.05, 0.06, 0.091)).export(tree / "box.stl")
    changed = parts_of(gpis_grasp("plan-all", tree, *QUICK, "--json", "-"))
    assert {name for name, part in changed.items() if not part["from_store"]} == {"box"}


def test_results_do_not_depend_on_the_number_of_jobs(gpis_grasp, tree, tmp_path):
    tried = (*QUICK[:-1], "rank", "--support", "lowest")
    paths = [tmp_path / f"{jobs}.sqlite" for jobs in (1, 3)]
    for jobs, path in zip((1, 3), paths, strict=True):
        there = ("--jobs", jobs, "--set", f"store.path={path}")
        gpis_grasp("plan-all", tree, *tried, *there)
    one, three = map(documents, paths)
    for document in (*one.values(), *three.values()):
        del document["settings"]["store"]
    assert one == three
    assert set(one) == {"box", "brick", "small/cube"}


def test_after_kill_9_it_goes_on_with_what_is_left(tree, path):
    command = [*PROGRAM, "plan-all", str(tree), *QUICK, "--jobs", "1"]
    process = subprocess.Popen(command, env=environment(), stdout=subprocess.DEVNULL)
    deadline = time.monotonic() + 120.0
    while not (path.exists() and GraspStore(path).entries()) and time.monotonic() < deadline:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    before = {entry.mesh_id: entry.made_s for entry in GraspStore(path).entries()}
    assert before
    answer = in_pipe("plan-all", tree, *QUICK, "--json", "-")
    parts = {part["mesh_id"]: part for part in json.loads(answer.stdout)["parts"]}
    assert all(parts[mesh_id]["from_store"] for mesh_id in before)
    after = {entry.mesh_id: entry.made_s for entry in GraspStore(path).entries()}
    assert set(after) == {"box", "brick", "small/cube"}
    assert before.items() <= after.items()


def test_ctrl_c_keeps_what_is_done(tree, path):
    process = subprocess.Popen(
        [*PROGRAM, "plan-all", str(tree), "--time", "600", "--jobs", "1", "--json", "-"],
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    part_under_way(process)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30.0)
    assert process.returncode == 130
    summary = json.loads(out)
    assert summary["interrupted"]
    assert summary["n_left"] >= 2
    assert "the same command goes on" in err


def test_the_table_in_80_columns_and_in_a_pipe(tree, path):
    code, screen = in_terminal(80, "plan-all", tree, *QUICK)
    assert code == 1
    assert all(len(line) < 80 for line in screen.splitlines())
    piped = in_pipe("plan-all", tree, *QUICK)
    heading = piped.stdout.splitlines()[0]
    assert heading.split() == ["mesh", "ID", "grasps", "epsilon", "held", "s", "plan", "state"]
    assert "0 planned now, 3 kept from before" in piped.stdout
    assert piped.stderr == ""


def test_without_a_store_it_says_so(gpis_grasp, tree):
    answer = gpis_grasp("plan-all", tree)
    assert answer.code == 1
    assert "store.path=FILE" in answer.err


def test_without_a_scheduler_both_commands_say_how_to_start_one(gpis_grasp, tree, monkeypatch):
    monkeypatch.setattr("gpis_grasp_planner.batch.cluster._CONNECT_S", 1.0)
    nobody = "tcp://127.0.0.1:9"
    there = ("--set", f"store.path={tree.parent / 'none.sqlite'}")
    for words in (("plan-all", tree, "--scheduler", nobody, *there), ("worker", nobody)):
        answer = gpis_grasp(*words)
        assert answer.code == 1
        assert "Start one with 'dask scheduler'" in answer.err
        assert len(answer.err.splitlines()) == 1


def test_jobs_are_for_this_machine(gpis_grasp, tree):
    answer = gpis_grasp("plan-all", tree, "--scheduler", "tcp://127.0.0.1:9", "--jobs", 2)
    assert answer.code == 1
    assert "gpis-grasp worker ADDRESS --jobs N" in answer.err


def test_the_progress_counts_by_what_is_planned_now():
    kept = Outcome("a", "SUCCESS", "", 3, from_store=True, mesh_hash="0")
    new = Outcome("b", "SUCCESS", "", 3, mesh_hash="0")
    bad = Outcome("c", "MESH_UNREADABLE", "")
    text = progress_text([kept, new, bad], 10, 30.0, ["d", "e"])
    assert text == "[###.......] 3/10, 2.0 a minute, 4 min left, 1 without grasp: d, e"
    assert progress_text([], 10, 0.0, []) == "[..........] 0/10"
