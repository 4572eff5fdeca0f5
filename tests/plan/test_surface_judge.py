"""A plan on a cloud: its grasps are judged by the surfaces drawn, and its answer says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from cloud_shapes import CENTER, sphere_points, xyz

from gpis_grasp_planner.geometry.catalogue import load_part
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.uncertainty import SurfaceUncertainty
from gpis_grasp_planner.grasp.order import answer_rank
from gpis_grasp_planner.plan.document import document_text, read_document
from gpis_grasp_planner.plan.objective import make_objective
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.plan.surface_judge import SurfaceJudge

REQUEST = PlanRequest(time_budget_s=30.0, max_evaluations=400, n_grasps=5, seed=3)
PLANNER = GraspPlanner()


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    path = tmp_path_factory.mktemp("cloud") / "ball.xyz"
    path.write_bytes(xyz(sphere_points(np.random.default_rng(5), 2000, 0.001, cap=0.0)[0]))
    eye = (CENTER + np.array([0.0, 0.0, 0.5])).tolist()
    path.with_suffix(".yaml").write_text(f"unit: m\nviewpoints: [{eye}]\n")
    settings = CatalogueSettings(cloud_samples=250, cloud_cells=36, cloud_draws=4)
    return load_part(path, settings=settings)


@pytest.fixture(scope="module")
def result(part):
    return PLANNER.plan(part, REQUEST)


def test_every_grasp_has_both_figures_with_their_meaning(part, result):
    assert result.grasps
    names = {figure.name for figure in result.figures}
    assert {"contact_deviation", "surface_hold"} <= names
    for grasp in result.grasps:
        figures = grasp.quality.measured
        at = part.uncertainty.deviation_at(grasp.contacts.positions)
        assert figures["contact_deviation"] == pytest.approx(np.sqrt(np.mean(at**2)))
        assert figures["surface_hold"] in (0.0, 0.25, 0.5, 0.75, 1.0)
    assert any("Reconstructed from a cloud of 2000 points" in note for note in result.notes)
    assert "contact_deviation" in result.objective


def test_surfaces_like_the_mean_hold_every_grasp_and_one_far_away_none(part, result):
    away = TriangleMesh(part.mesh.vertices + np.array([0.5, 0.0, 0.0]), part.mesh.faces)
    for surface, expected in ((part.mesh, 1.0), (away, 0.0)):
        at = part.uncertainty
        known = SurfaceUncertainty(at.points, at.deviation, (surface,))
        other = replace(part, uncertainty=known)
        judge = SurfaceJudge(other, PLANNER.hand, PLANNER.settings, PLANNER.prepare(other), REQUEST)
        for grasp in result.grasps:
            assert judge.judged(grasp).quality.measured["surface_hold"] == expected


def test_the_likelier_to_hold_on_all_surfaces_comes_first(part, result):
    objective = make_objective(PlannerSettings(), part)
    first = result.grasps[0]
    ranks = []
    for share in (1.0, 0.5, 0.0):
        measured = {**first.quality.measured, "surface_hold": share}
        ranks.append(
            answer_rank(
                replace(first, quality=replace(first.quality, measured=measured)), objective
            )
        )
    assert ranks == sorted(ranks)
    assert len(set(ranks)) == 3


def test_a_document_keeps_all_of_it_and_the_part_prepares_from_the_disk(part, result, tmp_path):
    path = tmp_path / "grasps.json"
    path.write_text(document_text(result))
    again = read_document(path).result
    for one, two in zip(result.grasps, again.grasps, strict=True):
        assert one.quality.measured == pytest.approx(two.quality.measured)
    settings = PlannerSettings.from_mapping({"cache": {"directory": str(tmp_path / "cache")}})
    made, kept = (GraspPlanner(settings).prepare(part) for _ in range(2))
    assert len(kept.draws) == 4
    for (field, tree), (kept_field, kept_tree) in zip(made.draws, kept.draws, strict=True):
        np.testing.assert_array_equal(field.values, kept_field.values)
        np.testing.assert_array_equal(tree.triangles, kept_tree.triangles)


def test_an_earlier_plan_answers_again_with_its_figures(part, result):
    answer = PLANNER.answer(part, REQUEST, known=result)
    assert answer.from_known
    assert all("surface_hold" in g.quality.measured for g in answer.result.grasps)
