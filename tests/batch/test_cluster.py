"""A real scheduler, real workers, each a process of its own; some of them killed in the middle."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import trimesh
from clusters import OTHER_VERSION, Cluster, kill_in_the_middle, part_under_way
from terminal_sessions import PROGRAM, environment, in_pipe

from gpis_grasp_planner.plan.document import document_of
from gpis_grasp_planner.store.grasp_store import GraspStore

QUICK = ("--evaluations", "96", "--grasps", "3", "--verify", "none")
TRIED = (*QUICK[:-1], "rank", "--support", "lowest")
LONG = ("--time", "600", "--verify", "none")


@pytest.fixture
def tree(tmp_path):
    """Four boxes, one of which is there by two names, and a file that is no mesh."""
    folder = tmp_path / "parts"
    (folder / "small").mkdir(parents=True)
    trimesh.creation.box((0.05, 0.06, 0.09)).export(folder / "box.stl")
    trimesh.creation.box((0.05, 0.06, 0.09)).export(folder / "small" / "carton.stl")
    trimesh.creation.box((0.04, 0.05, 0.07)).export(folder / "brick.stl")
    trimesh.creation.box((0.04, 0.05, 0.06)).export(folder / "cube.stl")
    trimesh.creation.box((40.0, 50.0, 55.0)).export(folder / "small" / "lump.stl")
    (folder / "small" / "lump.yaml").write_text("unit: mm\n")
    (folder / "bad.stl").write_text("no mesh\n")
    return folder


@pytest.fixture
def cluster(tmp_path):
    with Cluster(tmp_path / "cluster.log") as made:
        yield made


def parts_of(process):
    out, err = process.communicate(timeout=300.0)
    return {part["mesh_id"]: part for part in json.loads(out)["parts"]}, err


def plans(path):
    """Plans by mesh, without their names and what differs by the clock and the place of files."""
    found = {}
    for entry, record in GraspStore(path).records():
        document = document_of(record.result)
        for field in ("elapsed_s", "phase_s", "convergence", "mesh_id", "message"):
            del document[field]
        del document["settings"]["store"]
        found[entry.mesh_hash] = document
    return found


def test_the_plans_are_those_of_this_machine(tree, tmp_path, cluster):
    here, there = tmp_path / "here.sqlite", tmp_path / "there.sqlite"
    in_pipe("plan-all", tree, *TRIED, "--jobs", "1", "--set", f"store.path={here}")
    cluster.worker()
    cluster.worker()
    parts, _ = parts_of(cluster.plan_all(tree, there, *TRIED))
    assert parts["bad"]["code"] == "MESH_UNREADABLE"
    good = {name: part for name, part in parts.items() if name != "bad"}
    assert set(good) == {"box", "brick", "cube", "small/carton", "small/lump"}
    assert all(part["kept"] for part in good.values())
    # One content by two names is planned once.
    assert sum(not part["from_store"] for part in good.values()) == 4
    assert plans(here) == plans(there)
    assert len(plans(there)) == 4
    again, _ = parts_of(cluster.plan_all(tree, there, *TRIED))
    assert all(part["from_store"] for name, part in again.items() if name != "bad")


def test_a_worker_that_is_killed_costs_its_part_only(tree, tmp_path, cluster):
    (tree / "bad.stl").unlink()
    here, there = tmp_path / "here.sqlite", tmp_path / "there.sqlite"
    first, _ = cluster.worker(), cluster.worker()
    process = cluster.plan_all(tree, there, *QUICK)
    child = kill_in_the_middle(first)
    parts, _ = parts_of(process)
    assert process.returncode == 0
    assert all(part["kept"] for part in parts.values())
    assert not Path(f"/proc/{child}").exists()
    in_pipe("plan-all", tree, *QUICK, "--jobs", "1", "--set", f"store.path={here}")
    assert plans(here) == plans(there)


def test_a_part_on_which_workers_are_lost_too_often_is_named(tree, tmp_path):
    (tree / "bad.stl").unlink()
    store = tmp_path / "there.sqlite"
    once = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "0"}
    with Cluster(tmp_path / "cluster.log", **once) as cluster:
        first = cluster.worker()
        process = cluster.plan_all(tree, store, *QUICK)
        kill_in_the_middle(first)
        cluster.worker()
        parts, _ = parts_of(process)
    lost = [part for part in parts.values() if part["code"] == "PLANNING_PROCESS_LOST"]
    assert len(lost) == 1
    assert "1 workers were lost while they planned it" in lost[0]["message"]
    assert all(part["kept"] for part in parts.values() if part not in lost)


def test_ctrl_c_keeps_what_came_and_the_same_command_goes_on(tree, tmp_path, cluster):
    (tree / "bad.stl").unlink()
    store = tmp_path / "there.sqlite"
    cluster.worker()
    process = cluster.plan_all(tree, store, *QUICK)
    wait_for(lambda: store.exists() and GraspStore(store).entries())
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60.0)
    assert process.returncode == 130
    summary = json.loads(out)
    assert summary["n_left"] + len(summary["parts"]) == 5
    assert "the same command goes on" in err
    before = {entry.mesh_id: entry.made_s for entry in GraspStore(store).entries()}
    parts, _ = parts_of(cluster.plan_all(tree, store, *QUICK))
    assert all(part["kept"] for part in parts.values())
    after = {entry.mesh_id: entry.made_s for entry in GraspStore(store).entries()}
    assert before.items() <= after.items()


def test_a_scheduler_that_is_lost_ends_the_command_with_what_to_do(tree, tmp_path, cluster):
    worker = cluster.worker()
    process = cluster.plan_all(tree, tmp_path / "there.sqlite", *LONG)
    part_under_way(worker)
    cluster.scheduler.kill()
    _, err = process.communicate(timeout=60.0)
    assert process.returncode == 1
    assert err.splitlines()[-1].startswith("gpis-grasp: error: The scheduler tcp://127.0.0.1:")
    assert "the same command goes on" in err
    worker.wait(timeout=60.0)  # and its child with it


def test_a_worker_says_as_json_whom_it_serves(cluster):
    command = [*PROGRAM, "worker", cluster.address, "--jobs", "2", "--json"]
    with subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, text=True) as worker:
        said = json.loads(worker.stdout.readline())
        assert said.pop("worker").startswith("tcp://127.0.0.1:")
        assert said == {"jobs": 2, "scheduler": cluster.address}
        worker.send_signal(signal.SIGTERM)
        assert worker.wait(timeout=60.0) == 0


def test_a_worker_of_another_version_plans_nothing(tree, tmp_path, cluster):
    cluster.start([sys.executable, "-c", OTHER_VERSION, cluster.address])
    store = tmp_path / "there.sqlite"
    process = cluster.plan_all(tree, store, *QUICK)
    _, err = process.communicate(timeout=120.0)
    assert process.returncode == 1
    assert "planner 9.9+other, not" in err
    assert not store.exists() or GraspStore(store).entries() == []


def test_a_worker_of_another_version_that_comes_later_ends_the_command(tree, tmp_path, cluster):
    first = cluster.worker()
    process = cluster.plan_all(tree, tmp_path / "there.sqlite", *LONG)
    part_under_way(first)
    cluster.start([sys.executable, "-c", OTHER_VERSION, cluster.address])
    _, err = process.communicate(timeout=120.0)
    assert process.returncode == 1
    assert "planner 9.9+other, not" in err


def test_a_worker_under_dasks_nanny_says_what_to_do(tree, tmp_path, cluster):
    program = "from distributed.cli.dask_worker import main; main()"
    words = ("--nthreads", "1", "--no-dashboard", "--local-directory", str(tmp_path))
    cluster.start([sys.executable, "-c", program, cluster.address, *words])
    process = cluster.plan_all(tree, tmp_path / "there.sqlite", *QUICK)
    _, err = process.communicate(timeout=120.0)
    assert process.returncode == 1
    assert "dask worker --no-nanny" in err


def wait_for(true, limit_s=120.0):
    deadline = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.02)
