"""What the hand cannot do is told with its reason; what can be grasped is never refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan import run as run_module
from gpis_grasp_planner.plan.hand_limits import limit_of
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.progress import Monitor
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.surroundings.obstacles import SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place

CATALOGUE = MeshCatalogue([default_catalogue_directory()])
FRICTION = Friction(0.6, 0.6)
SETTINGS = PlannerSettings()
UP = np.array([0.0, 0.0, 1.0])


def limit(part, place=None):
    monitor = Monitor(10.0)
    return limit_of(part, load_hand(), FRICTION, place or Place(), SETTINGS, monitor)


def on_table(part):
    lowest = np.array([0.0, 0.0, part.mesh.bounds[0, 2]])
    return Place(surroundings=Surroundings(SupportPlane(lowest, UP)))


@pytest.mark.parametrize("mesh_id", CATALOGUE.ids())
def test_no_shipped_part_is_refused_free_or_on_a_table(mesh_id):
    part = CATALOGUE.load(mesh_id)
    assert limit(part) is None
    assert limit(part, on_table(part)) is None


def test_an_open_surface_is_not_refused_for_its_one_side(oracle):
    crate = oracle.make_part("crate", trimesh.creation.box([0.9, 0.9, 0.9]), FRICTION)
    assert limit(crate) is not None
    assert limit(replace(crate, watertight=False)) is None


def test_a_sheet_flat_on_the_table_is_refused_with_its_height(oracle):
    sheet = oracle.make_part("sheet", trimesh.creation.box([0.2, 0.1, 0.001]), FRICTION)
    found = limit(sheet, on_table(sheet))
    assert found.code is ErrorCode.ALL_GRASPS_BLOCKED
    assert "rises 1.0 mm above 'support'" in found.message
    assert "clearance.margin_m" in found.message
    assert limit(sheet) is None


def test_a_search_for_what_is_refused_finds_nothing_either(oracle, monkeypatch):
    sheet = oracle.make_part("sheet", trimesh.creation.box([0.1, 0.06, 0.001]), FRICTION)
    place, planner = on_table(sheet), GraspPlanner()
    request = PlanRequest(seed=2, time_budget_s=8.0)
    told = planner.answer(sheet, request, place).result
    assert (told.code, told.evaluations) == (ErrorCode.ALL_GRASPS_BLOCKED, 0)
    monkeypatch.setattr(run_module, "limit_of", lambda *_: None)
    searched = planner.answer(sheet, request, place).result
    assert searched.evaluations > 0
    assert searched.grasps == ()
