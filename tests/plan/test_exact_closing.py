"""A fine mesh: searched on its simplified one, answered with grasps of all of its triangles."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.disk_cache import CacheSettings
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.plan.exact_closing import ExactClosing
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.preparation import Preparation
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.objective import EpsilonVolume
from gpis_grasp_planner.quality.wrench_space import grasp_quality
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.archive import Candidate

FRICTION = Friction(0.6, 0.6)


@pytest.fixture(scope="module")
def fine(tmp_path_factory):
    """A bumpy knob of 82,000 triangles, read as a user's file is."""
    ball = trimesh.creation.icosphere(subdivisions=6, radius=0.035)
    v = np.asarray(ball.vertices)
    r = 1.0 + 0.08 * np.sin(5.0 * np.arctan2(v[:, 1], v[:, 0])) * (1.0 - (v[:, 2] / 0.035) ** 2)
    ball.vertices = v * r[:, None]
    path = tmp_path_factory.mktemp("meshes") / "knob.stl"
    ball.export(path)
    return MeshCatalogue([path.parent]).load("knob")


@pytest.fixture(scope="module")
def prepared(fine):
    return Preparation(PlannerSettings()).of(fine)


def test_the_search_has_the_tree_of_the_simplified_mesh(fine, prepared):
    assert len(fine.mesh.faces) > 80_000
    assert fine.simplified is not None
    assert 0.0 < fine.simplified_apart_m < 1e-4
    assert len(prepared.tree.triangles) == len(fine.mesh.faces)
    assert len(prepared.for_search.tree.triangles) == len(fine.simplified.faces)
    assert prepared.for_search.field is prepared.field


def test_one_that_is_too_far_from_the_mesh_is_not_searched_on(fine):
    far = replace(fine, simplified_apart_m=1.1e-4)
    assert Preparation(PlannerSettings()).of(far).coarse is None


def test_a_small_mesh_is_searched_as_it_is(catalogue):
    prepared = Preparation(PlannerSettings()).of(catalogue.load("sphere"))
    assert prepared.coarse is None
    assert prepared.for_search is prepared


def test_the_disk_keeps_both_trees(fine, prepared, tmp_path):
    settings = replace(PlannerSettings(), cache=CacheSettings(directory=str(tmp_path / "objects")))
    Preparation(settings).of(fine)
    again = Preparation(settings).of(fine)
    for f in fields(prepared.coarse):
        np.testing.assert_array_equal(
            getattr(again.coarse, f.name), getattr(prepared.coarse, f.name)
        )


@pytest.mark.parametrize("verification", ["none", "rank"])
def test_answered_grasps_are_those_of_the_whole_mesh(fine, prepared, verification):
    request = PlanRequest(
        time_budget_s=600.0 if verification == "none" else 8.0,
        max_evaluations=700 if verification == "none" else None,
        n_grasps=8,
        friction=FRICTION,
        verification=verification,
        seed=5,
    )
    result = GraspPlanner().answer(fine, request).result
    assert len(result.grasps) >= (4 if verification == "none" else 1)
    whole = CompiledEvaluator(
        load_hand(), fine, FRICTION, PlannerSettings().scene, prepared.field, prepared.tree
    )
    found = whole.attempt_from(
        np.stack([grasp.T_object_palm for grasp in result.grasps]),
        np.stack([grasp.pregrasp_joints for grasp in result.grasps]),
    )
    assert (found.status == AttemptStatus.GRASPED).all()
    for k, grasp in enumerate(result.grasps):
        np.testing.assert_allclose(found.joints[k], grasp.joints, atol=5e-3)
        exact = grasp_quality(
            grasp.contacts, fine.center_of_mass, fine.max_radius, PlannerSettings().scene.cone_edges
        )
        assert grasp.epsilon == pytest.approx(exact.epsilon, abs=1e-12)
        distance = prepared.tree.nearest(grasp.contacts.positions)[1]
        assert distance.max() < 1e-6  # on the mesh itself


def test_a_palm_that_lies_in_the_mesh_goes_back_a_little_or_is_no_grasp(fine, prepared):
    hand, settings = load_hand(), PlannerSettings()
    whole = CompiledEvaluator(hand, fine, FRICTION, settings.scene, prepared.field, prepared.tree)
    closing = ExactClosing(whole, hand, EpsilonVolume(1.0))
    face = 0.079
    T = np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = 0.035 + face
    spread = np.zeros((1, 1))
    touching, free = whole.clear_palm(T[None], np.array([[0.0, 0.0, 1.0]]), spread, np.zeros(1))
    assert free.all()
    kept = lost = 0
    for depth in (0.0, 8e-5, 3e-3):
        deep = touching.copy()
        deep[0, 2, 3] -= depth
        attempt = replace(whole.attempt(touching, spread), T_object_palm=deep)
        found = closing(Candidate(attempt, 0, 0.1))
        if found is None:
            assert depth > 1e-3
            lost += 1
            continue
        kept += 1
        back = found.T_object_palm[2, 3] - deep[0, 2, 3]
        assert 0.0 <= back <= 2e-4 + 1e-12
        assert (back > 0.0) == (depth > 0.0)
        assert found.epsilon > 0.0
    assert (kept, lost) == (2, 1)
