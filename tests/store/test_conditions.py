"""What makes another plan has another key, and what makes the same one has the same."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np

from gpis_grasp_planner.geometry.uncertainty import SurfaceUncertainty
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.store.conditions import Conditions


def test_a_changed_hand_of_ones_own_is_planned_for_anew(box, tmp_path):
    shutil.copytree(load_hand("parallel_jaw").yaml_path.parent, tmp_path / "own")
    [path] = (tmp_path / "own").glob("*.yaml")
    before, again = (key_of(box, path) for _ in range(2))
    path.write_text(path.read_text() + "# another\n")
    load_hand.cache_clear()  # a process that reads it now
    assert before == again != key_of(box, path)


def test_other_surfaces_drawn_for_a_scan_are_another_plan(box):
    points, deviation = box.mesh.vertices, np.full(len(box.mesh.vertices), 0.001)
    keys = [
        Conditions.of(part, PlanRequest(), PlannerSettings(), load_hand()).key
        for part in (
            box,
            replace(box, uncertainty=SurfaceUncertainty(points, deviation, (box.mesh,))),
            replace(box, uncertainty=SurfaceUncertainty(points, deviation, (box.mesh,) * 2)),
            replace(box, uncertainty=SurfaceUncertainty(points, 2 * deviation, (box.mesh,))),
        )
    ]
    assert len(set(keys)) == 4


def test_an_objective_counts_alike_from_request_and_settings(box):
    task = "turn 0 0 1"
    settings = PlannerSettings.from_mapping({"objective": {"name": "task", "task": task}})
    keys = [
        Conditions.of(box, request, chosen, load_hand()).key
        for request, chosen in (
            (PlanRequest(), PlannerSettings()),
            (PlanRequest(task=task), PlannerSettings()),
            (PlanRequest(objective="task", task=task), PlannerSettings()),
            (PlanRequest(), settings),
        )
    ]
    assert keys[0] != keys[1] == keys[2] == keys[3]


def key_of(box, path):
    settings = PlannerSettings.from_mapping({"hand": {"model": str(path)}})
    return Conditions.of(box, PlanRequest(), settings, load_hand(str(path))).key
