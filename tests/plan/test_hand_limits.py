"""What the hand cannot do is told with its reason; what can be grasped is never refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.geometry.catalogue import (
    MeshCatalogue,
    default_catalogue_directory,
    load_part,
)
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


def dowel(diameter_mm, length_mm):
    """A solid pin along x, its ends rounded by 0.3 of the radius as the set of hard parts' are."""
    r, h = 0.5e-3 * diameter_mm, 0.5e-3 * length_mm
    turn = np.linspace(0.0, 0.5 * np.pi, 7)
    end = np.stack([0.7 * r + 0.3 * r * np.sin(turn), h - 0.3 * r + 0.3 * r * np.cos(turn)], axis=1)
    outline = np.concatenate([[[0.0, -h]], end[:, :] * [1, -1], end[::-1], [[0.0, h]]])
    pin = trimesh.creation.revolve(outline, sections=24)
    pin.apply_transform(trimesh.transformations.rotation_matrix(0.5 * np.pi, [0, 1, 0]))
    return pin


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
    crate = replace(crate, mass=1.0)
    assert limit(crate) is not None
    assert limit(replace(crate, watertight=False)) is None


def test_a_sheet_flat_on_the_table_is_refused_with_its_height(oracle):
    sheet = oracle.make_part("sheet", trimesh.creation.box([0.2, 0.1, 0.001]), FRICTION)
    found = limit(sheet, on_table(sheet))
    assert found.code is ErrorCode.ALL_GRASPS_BLOCKED
    assert "rises 1.0 mm above 'support'" in found.message
    assert "clearance.margin_m" in found.message
    assert limit(sheet) is None


@pytest.mark.parametrize("length_mm", [20, 60])
def test_a_pin_of_3_mm_on_the_table_is_refused_with_its_height(oracle, length_mm):
    pin = oracle.make_part("pin", dowel(3.0, length_mm), FRICTION)
    found = limit(pin, on_table(pin))
    assert found.code is ErrorCode.ALL_GRASPS_BLOCKED
    assert "rises 3.0 mm above 'support'" in found.message
    assert "3.0 mm (clearance.margin_m)" in found.message
    assert "friction angle of 31 degrees" in found.message
    assert limit(pin) is None  # free it is held: eleven of eleven grasps of one 40 mm long
    thick = oracle.make_part("thick", dowel(5.0, length_mm), FRICTION)
    assert limit(thick, on_table(thick)) is None


def test_a_part_over_the_payload_is_refused_where_its_mass_is_known(oracle):
    heavy = replace(oracle.make_part("heavy", trimesh.creation.box([0.08, 0.08, 0.12])), mass=6.1)
    found = limit(heavy)
    assert found.code is ErrorCode.NO_FEASIBLE_GRASP
    assert "weighs 6.1 kg, more than the hand carries (6 kg" in found.message
    assert limit(replace(heavy, mass_assumed=True)) is None
    assert limit(replace(heavy, mass=6.0)) is None


def test_the_catalogue_says_which_mass_is_assumed(tmp_path):
    source = default_catalogue_directory() / "mug.stl"
    for sidecar, assumed in (
        ("unit: mm\n", True),
        ("unit: mm\ndensity: 7850\n", False),
        ("unit: mm\nmass: 0.3\n", False),
    ):
        (tmp_path / "mug.stl").write_bytes(source.read_bytes())
        (tmp_path / "mug.yaml").write_text(sidecar)
        assert load_part(tmp_path / "mug.stl").mass_assumed is assumed


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
