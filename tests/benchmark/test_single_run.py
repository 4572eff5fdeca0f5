"""Real processes: the record crosses over, and a death is a message."""

from __future__ import annotations

import json

import pytest

from gpis_grasp_benchmark.runs import execute, object_hash
from gpis_grasp_benchmark.single_run import RunProcesses
from gpis_grasp_planner.errors import SystemFault
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.document_reader import parse_document, result_from_dict
from gpis_grasp_planner.plan.settings import PlannerSettings


@pytest.fixture(scope="module")
def part() -> Part:
    return MeshCatalogue([default_catalogue_directory()]).load("coupling_hub")


def test_a_run_in_its_own_process_is_the_run_in_this_one(make_run, part: Part) -> None:
    run = make_run(
        object_id=part.mesh_id,
        object_hash=object_hash(part),
        planner="random-adaption",
        max_evaluations=96,
        time_budget_s=120.0,
        n_grasps=4,
        settings=PlannerSettings().as_dict(),
    )
    record, text = RunProcesses().execute(run, part)
    here, _ = execute(run, part)
    volatile = ("elapsed_s", "cpu_s", "convergence", "environment")
    assert {k: v for k, v in record.items() if k not in volatile} == {
        k: v for k, v in json.loads(json.dumps(here)).items() if k not in volatile
    }
    assert [c[1:] for c in record["convergence"]] == [list(c[1:]) for c in here["convergence"]]
    result, _ = result_from_dict(parse_document(text.encode(), "answer"))
    assert [g.epsilon for g in result.grasps] == record["epsilon"]
    assert result.mesh_hash == part.mesh.content_hash


def test_an_error_in_the_process_is_told(make_run, part: Part) -> None:
    run = make_run(planner="nonsense")
    with pytest.raises(SystemFault, match="Unknown planner 'nonsense'"):
        RunProcesses().execute(run, part)


def test_nothing_starts_after_a_stop(make_run, part: Part) -> None:
    processes = RunProcesses()
    processes.stop()
    with pytest.raises(SystemFault, match="stopped"):
        processes.execute(make_run(), part)
