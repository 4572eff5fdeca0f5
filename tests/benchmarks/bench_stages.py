"""Benchmarks of each stage, by pytest-benchmark; `make bench` compares with a former version.

    python tests/benchmarks/bench.py

Not collected by `make test`. What is called here is in the former version as well.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.optimise.bayesian import BayesianOptimiser, BayesianSettings
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.fast_epsilon import fast_epsilon, start_directions
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.search_space import PalmSearchSpace
from gpis_grasp_planner.surface.implicit_surface import fit_part
from gpis_grasp_planner.verification.convex_cover import convex_cover
from gpis_grasp_planner.verification.protocol import Verifier, prepare
from gpis_grasp_planner.verification.settings import VerificationSettings

PARTS = ("mug", "flange", "phone", "spur_gear")
FRICTION = Friction(0.4, 0.3)
N_HANDS = 200
# Timed once in a round: what is prepared for them is used up, or they take long.
ONCE = {"rounds": 3, "iterations": 1, "warmup_rounds": 1}

each_part = pytest.mark.parametrize("mesh_id", PARTS)


@cache
def scene(mesh_id: str) -> SimpleNamespace:
    """A part, its evaluator, and palms of the search space, moved along their axis until free."""
    part, hand = MeshCatalogue([default_catalogue_directory()]).load(mesh_id), load_hand()
    evaluator = CompiledEvaluator(hand, part, FRICTION, SceneSettings())
    rng = np.random.default_rng(11)
    space = PalmSearchSpace(part.mesh.bounds, 0.06)
    # The former version takes one figure a hand in place of a vector.
    shape = (N_HANDS, 1) if hasattr(load_hand(), "preshape") else (N_HANDS,)
    T, spread = space.poses(space.domain.sample(N_HANDS, rng)), rng.uniform(0.0, 3.0, shape)
    T[:, :3, 3] = 0.3 * T[:, :3, 3] - 0.08 * T[:, :3, 2]
    normals = -T[:, :3, 2]
    free, _ = evaluator.clear_palm(T, normals, spread, np.zeros(N_HANDS))
    return SimpleNamespace(
        part=part, evaluator=evaluator, taken=T, normals=normals, spread=spread, T=free
    )


@cache
def planned(mesh_id: str):
    """A grasp, and what it was found with."""
    planner = GraspPlanner(PlannerSettings())
    request = PlanRequest(
        time_budget_s=60.0, verification="none", max_evaluations=500, n_grasps=1, seed=0
    )
    return planner, planner.answer(scene(mesh_id).part, request).result.grasps[0]


@each_part
def test_reading_and_judging(benchmark, mesh_id):
    benchmark(MeshCatalogue([default_catalogue_directory()]).load, mesh_id)


@each_part
def test_surface(benchmark, mesh_id):
    mesh, settings = scene(mesh_id).part.working_mesh, PlannerSettings().surface
    benchmark.pedantic(fit_part, (mesh, settings), **ONCE)


@each_part
def test_distance_field(benchmark, mesh_id):
    benchmark.pedantic(DistanceField.of, (scene(mesh_id).part.working_mesh,), **ONCE)


@each_part
def test_triangle_tree(benchmark, mesh_id):
    benchmark(TriangleTree.of, scene(mesh_id).part.mesh)


@each_part
def test_palms_out_of_collision_200(benchmark, mesh_id):
    s = scene(mesh_id)
    benchmark(s.evaluator.clear_palm, s.taken, s.normals, s.spread, np.zeros(N_HANDS))


@each_part
def test_attempts_200(benchmark, mesh_id):
    s = scene(mesh_id)
    found = benchmark(s.evaluator.attempt, s.T, s.spread)
    assert (found.epsilon > 0.0).any()


@pytest.mark.parametrize("n_contacts", [3, 8])
def test_epsilon_without_hull_of_100_grasps(benchmark, n_contacts):
    rng = np.random.default_rng(n_contacts)
    wrenches = [rng.normal(size=(8 * n_contacts, 6)) for _ in range(100)]
    directions = start_directions(256)

    def epsilons() -> list[float]:
        return [fast_epsilon(W, directions, 5) for W in wrenches]

    benchmark(epsilons)


@pytest.mark.parametrize("n_told", [100, 300])
def test_model_fit_and_eight_acquisitions(benchmark, n_told):
    rng = np.random.default_rng(3)
    domain = PalmSearchSpace(scene("mug").part.mesh.bounds, 0.06).domain
    x = domain.sample(n_told, rng)
    y = np.exp(-((x - x[0]) ** 2).sum(axis=1))

    def told():
        optimiser = BayesianOptimiser(domain, settings=BayesianSettings(n_initial=8), seed=5)
        optimiser.ask_batch(8)  # the initial design
        optimiser.tell(x, y)
        return (optimiser,), {}

    benchmark.pedantic(lambda optimiser: optimiser.ask_batch(8), setup=told, rounds=5)


@each_part
def test_cover_by_convex_pieces(benchmark, mesh_id):
    s = scene(mesh_id)
    what = (s.part.working_mesh, s.evaluator.field, s.evaluator.tree)
    benchmark.pedantic(convex_cover, what, rounds=1, iterations=1)


@each_part
def test_trial_in_physics(benchmark, mesh_id):
    s = scene(mesh_id)
    planner, grasp = planned(mesh_id)
    settings = VerificationSettings()
    with Verifier(s.part, planner.hand, settings, prepare(s.part, settings)) as verifier:
        benchmark.pedantic(verifier.verify, (grasp,), **ONCE)
