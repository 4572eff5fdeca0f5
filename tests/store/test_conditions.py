"""A hand of the user's own is another one when a file of it changes, under the same name."""

from __future__ import annotations

import shutil

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.store.conditions import Conditions


def test_a_changed_hand_of_ones_own_is_planned_for_anew(box, tmp_path):
    shutil.copytree(load_hand("parallel_jaw").yaml_path.parent, tmp_path / "own")
    [path] = (tmp_path / "own").glob("*.yaml")
    before, again = (key_of(box, path) for _ in range(2))
    path.write_text(path.read_text() + "# another\n")
    assert before == again != key_of(box, path)


def key_of(box, path):
    settings = PlannerSettings.from_mapping({"hand": {"model": str(path)}})
    return Conditions.of(box, PlanRequest(), settings, load_hand(str(path))).key
