"""What is kept comes back as it was, for what it was made and for nothing else."""

from __future__ import annotations

import json
import os
import pickle
import zlib
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from planning_fixtures import make_part
from store_writers import killed_writers, record_of

from gpis_grasp_planner.forked_child import ForkedChild
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.document import document_of
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.store_settings import StoreSettings
from gpis_grasp_planner.store import record
from gpis_grasp_planner.store.conditions import Conditions
from gpis_grasp_planner.store.grasp_store import GraspStore, store_path
from gpis_grasp_planner.store.record import Record
from gpis_grasp_planner.surroundings.place import Place

FREE = Place()
TABLE = Place.from_mapping({"support": {"point": [0.0, 0.0, -0.045]}})
LOW_TABLE = Place.from_mapping({"support": {"point": [0.0, 0.0, -0.044]}})
FAR_TABLE = Place.from_mapping({"support": {"point": [0.0, 0.0, -0.2]}})


def find(store, part, request, place=FREE, settings=None, hand=None, **options):
    conditions = Conditions.of(part, request, settings or PlannerSettings(), hand or load_hand())
    return store.find(part, conditions, request, place, **options)


def at(record, place):
    return replace(record, result=replace(record.result, place=place.as_mapping()))


def rounded(values):
    """Without the last bits: directions and quaternions are made units again when read."""
    return json.loads(json.dumps(values), parse_float=lambda text: round(float(text), 14))


def test_a_plan_comes_back_as_it_was_with_its_reserve(store, box, plan):
    assert store.put(record_of(box, plan))
    kept = find(GraspStore(store.database.path), box, plan.request)
    assert kept.same_place
    got = kept.record.result
    assert rounded(document_of(got)) == rounded(document_of(plan))
    assert len(got.reserve) == len(plan.reserve)
    for one, other in zip(got.reserve.estimates, plan.reserve.estimates, strict=True):
        np.testing.assert_allclose(one.T_object_palm, other.T_object_palm, atol=1e-12)
        np.testing.assert_array_equal(one.joints, other.joints)
        np.testing.assert_array_equal(one.contacts.positions, other.contacts.positions)


def test_anything_else_is_planned_anew(store, box, plan):
    store.put(record_of(box, plan))
    request = plan.request
    bigger = make_part("box", trimesh.creation.box((0.05, 0.06, 0.0901)))
    assert find(store, bigger, request) is None
    assert find(store, replace(box, mass=2.0 * box.mass), request) is None
    assert find(store, box, request, hand=load_hand("parallel_jaw")) is None
    other = PlannerSettings.from_mapping({"hpp": {"volume_weight": 0.25}})
    assert find(store, box, request, settings=other) is None
    for change in (
        {"seed": 1},
        {"max_evaluations": 129},
        {"max_evaluations": None},
        {"verification": "rank"},
        {"planner": "hpp"},
        {"time_budget_s": 61.0},
        {"n_grasps": 4},
    ):
        assert find(store, box, replace(request, **change)) is None, change


def test_another_version_of_the_planner_plans_anew(store, box, plan, monkeypatch):
    store.put(record_of(box, plan))
    monkeypatch.setattr("gpis_grasp_planner.store.conditions.planner_version", lambda: "9.9+x")
    assert find(store, box, plan.request) is None


def test_where_things_are_kept_is_no_other_plan(store, box, plan):
    store.put(record_of(box, plan))
    elsewhere = PlannerSettings.from_mapping(
        {"cache": {"directory": "/nowhere"}, "store": {"path": "/nowhere"}}
    )
    assert find(store, box, plan.request, settings=elsewhere) is not None


def test_a_larger_plan_serves_a_smaller_request_and_other_names_of_the_mesh(store, box, plan):
    store.put(record_of(box, plan))
    smaller = replace(plan.request, time_budget_s=1.0, n_grasps=1)
    kept = find(store, replace(box, mesh_id="carton"), smaller)
    assert kept.record.result.mesh_id == "carton"


def test_several_places_of_a_part_are_kept(store, box, plan):
    made = record_of(box, plan)
    for place in (TABLE, FAR_TABLE):
        store.put(at(made, place))
    assert find(store, box, plan.request, LOW_TABLE).record.result.place == TABLE.as_mapping()
    assert find(store, box, plan.request, FAR_TABLE).same_place
    assert not find(store, box, plan.request).same_place
    assert find(store, box, plan.request, elsewhere=False) is None
    store.put(at(made, LOW_TABLE))  # like TABLE: takes its place
    assert len(store.entries()) == 2


def test_a_smaller_plan_does_not_take_the_place_of_a_larger_one(store, box, plan):
    store.put(record_of(box, plan))
    store.put(record_of(box, plan, time_budget_s=1.0))
    assert find(store, box, plan.request) is not None
    assert len(store.entries()) == 2
    store.put(record_of(box, plan, time_budget_s=90.0))
    assert len(store.entries()) == 1


def test_what_was_not_used_for_longest_goes_first(store, box, plan):
    size = len(record_of(box, plan).packed())
    small = GraspStore(store.database.path, most_bytes=int(2.5 * size))
    for seed in (0, 1):
        small.put(record_of(box, plan, seed=seed))
    find(small, box, replace(plan.request, seed=0))
    small.put(record_of(box, plan, seed=2))
    kept = {record.result.request.seed for _, record in small.records()}
    assert kept == {0, 2}


def test_the_reserve_is_read_when_it_is_asked_for_and_travels_unread(store, box, plan, monkeypatch):
    store.put(record_of(box, plan))
    read = record._grasps
    calls = []
    monkeypatch.setattr(record, "_grasps", lambda *given: calls.append(given) or read(*given))
    kept = find(store, box, plan.request).record.result
    assert not calls
    assert len(kept.reserve) == len(plan.reserve)
    assert len(calls) == 1
    monkeypatch.undo()
    unread = find(store, box, plan.request).record.result
    sent = pickle.loads(pickle.dumps(unread.reserve)).estimates
    for one, other in zip(sent, plan.reserve.estimates, strict=True):
        np.testing.assert_array_equal(one.joints, other.joints)


def test_plans_of_programs_that_kept_all_in_one_are_read(box, plan):
    own = record_of(box, plan)
    text = json.dumps(own.as_mapping())
    former = record.unpack(zlib.compress(text.encode()), "former")
    assert former.as_mapping() == record.unpack(own.packed(), "present").as_mapping()


def test_a_use_is_on_the_disk_when_it_is_noted(store, box, plan):
    store.put(record_of(box, plan))
    [before] = store.entries()
    find(store, box, plan.request)
    assert store.entries() == [before]
    store.note_uses()
    [after] = store.entries()
    assert after.used_s > before.used_s
    assert replace(after, used_s=before.used_s) == before


def test_two_processes_write_at_once_and_nothing_is_lost(store, box, plan):
    path, n = store.database.path, 15

    def write(first):
        def serve(connection):
            mine = GraspStore(path, wait_s=60.0)
            done = [mine.put(record_of(box, plan, seed=first + i)) for i in range(n)]
            connection.send(done)

        return serve

    with ForkedChild(write(0)) as one, ForkedChild(write(100)) as other:
        assert all(one.connection.recv())
        assert all(other.connection.recv())
    assert len(store.entries()) == 2 * n
    assert store.database.faults() == []
    assert all(isinstance(record, Record) for _, record in store.records())


def test_what_was_acknowledged_survives_kill_9(store, box, plan, rng):
    told, there = killed_writers(store.database.path, box, plan, 10, rng)
    assert told >= 10
    # A plan may be on the disk before its writer could say so.
    assert told <= there <= told + 10


def test_where_the_file_is(monkeypatch, tmp_path):
    assert store_path(StoreSettings()) is None  # the tests' environment says off
    monkeypatch.delenv("GPIS_GRASP_STORE")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert store_path(StoreSettings()) == tmp_path / "gpis_grasp_planner/grasps.sqlite"
    monkeypatch.setenv("GPIS_GRASP_STORE", "here.sqlite")
    assert os.fspath(store_path(StoreSettings())) == "here.sqlite"
    assert os.fspath(store_path(StoreSettings(path="a.sqlite"))) == "a.sqlite"
    assert store_path(StoreSettings(path="a.sqlite", enabled=False)) is None
    assert GraspStore.of(StoreSettings(enabled=False)) is None


@pytest.mark.parametrize("place", [FREE, TABLE])
def test_the_next_process_answers_from_the_store(store, box, place):
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.plan.request import PlanRequest
    from gpis_grasp_planner.store.answering import answer_with_store

    request = PlanRequest(time_budget_s=60.0, max_evaluations=128, n_grasps=3)
    first = answer_with_store(GraspPlanner(), store, box, request, place)
    assert (first.from_store, first.kept) == (False, True)
    again = answer_with_store(GraspPlanner(), GraspStore(store.database.path), box, request, place)
    assert (again.from_store, again.kept) == (True, True)
    assert again.answer.result.notes[-1].startswith("From the grasp store: planned 20")
    ours, theirs = again.answer.result.grasps, first.answer.result.grasps
    assert [g.epsilon for g in ours] == [g.epsilon for g in theirs]
    assert len(store.entries()) == 1
