"""The command 'store' on a file of its own: whole tables, JSON, and words for what went wrong."""

from __future__ import annotations

import json
import sqlite3

import pytest
import trimesh
from planning_fixtures import make_part
from store_writers import record_of, small_plan

from gpis_grasp_planner.plan.document import read_document
from gpis_grasp_planner.store.grasp_store import GraspStore

HEADINGS = "no. mesh ID place budget [s] grasps held epsilon age used kB mesh state"


@pytest.fixture(scope="module")
def records():
    box = make_part("box", trimesh.creation.box((0.05, 0.06, 0.09)))
    plan = small_plan(box)
    return [record_of(box, plan, seed=seed) for seed in range(3)]


@pytest.fixture
def path(tmp_path, monkeypatch, records):
    path = tmp_path / "grasps.sqlite"
    monkeypatch.setenv("GPIS_GRASP_STORE", str(path))
    for record in records:
        GraspStore(path).put(record)
    return path


def test_the_list_is_whole(gpis_grasp, path):
    answer = gpis_grasp("store")
    assert answer.code == 0
    lines = answer.out.splitlines()
    assert lines[0].split() == HEADINGS.split()
    assert all(line.endswith("SUCCESS") and " box " in line for line in lines[2:5])
    assert lines[-1].startswith("3 plans, ")
    assert lines[-1].endswith(f"MB in {path}")


def test_json_names_every_plan(gpis_grasp, path):
    facts = json.loads(gpis_grasp("store", "list", "--json").out)
    assert facts["path"] == str(path)
    assert {plan["id"] for plan in facts["plans"]} == {1, 2, 3}
    assert all(plan["usable"] for plan in facts["plans"])


def test_show_is_a_document(gpis_grasp, path, tmp_path):
    answer = gpis_grasp("store", "show", "2")
    (tmp_path / "two.json").write_text(answer.out)
    assert read_document(tmp_path / "two.json").result.request.seed == 1
    wrong = gpis_grasp("store", "show", "7")
    assert wrong.code == 1
    assert "There is no plan 7; there are 1, 2, 3." in wrong.err


def test_export_and_import_carry_all(gpis_grasp, path, tmp_path):
    file, other = tmp_path / "plans.jsonl", tmp_path / "other.sqlite"
    assert gpis_grasp("store", "export", str(file)).code == 0
    there = ("--set", f"store.path={other}")
    assert json.loads(gpis_grasp("store", "import", str(file), "--json", *there).out) == {
        "imported": 3
    }
    kept, carried = GraspStore(path).entries(), GraspStore(other).entries()
    assert {(e.key, e.made_s) for e in kept} == {(e.key, e.made_s) for e in carried}
    assert gpis_grasp("store", "verify", *there).code == 0


def test_a_bad_line_is_named_and_nothing_is_imported(gpis_grasp, path, tmp_path):
    file, other = tmp_path / "plans.jsonl", tmp_path / "other.sqlite"
    gpis_grasp("store", "export", str(file))
    lines = file.read_text().splitlines()
    lines[1] = lines[1].replace('"seed":1', '"seed":2', 1)
    file.write_text("\n".join(lines))
    answer = gpis_grasp("store", "import", str(file), "--set", f"store.path={other}")
    assert answer.code == 1
    assert "Line 2 of plans.jsonl" in answer.err
    assert GraspStore(other).entries() == []


def test_verify_tells_a_damaged_plan(gpis_grasp, path):
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE plans SET content = x'00' WHERE id = 2")
    answer = gpis_grasp("store", "verify")
    assert answer.code == 1
    assert "2 (box): Plan 2 of the grasp store is damaged." in answer.out
    assert "3 plans read, 1 faults" in answer.out


def test_prune_takes_what_no_planner_of_now_can_use(gpis_grasp, path):
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE plans SET planner_version = 'old' WHERE id = 2")
    assert "1 of them are of another version" in gpis_grasp("store").out
    assert json.loads(gpis_grasp("store", "prune", "--json").out)["removed"] == 1
    assert {entry.id for entry in GraspStore(path).entries()} == {1, 3}
    assert json.loads(gpis_grasp("store", "prune", "--all", "--json").out)["removed"] == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("show",), "'store show' needs the number of a plan"),
        (("export",), "'store export' needs a file"),
        (("list", "--all"), "takes neither --all nor --unused-days"),
        (("prune", "--unused-days", "-3"), "--unused-days is -3"),
        (("prune", "--unused-days", "nan"), "--unused-days is nan"),
        (("list", "3"), "'store list' takes no '3'"),
    ],
)
def test_wrong_usage_is_said(gpis_grasp, path, words, said):
    answer = gpis_grasp("store", *words)
    assert answer.code == 1
    assert said in answer.err
    assert len(GraspStore(path).entries()) == 3


def test_switched_off(gpis_grasp):
    answer = gpis_grasp("store")
    assert answer.code == 1
    assert "switched off" in answer.err
