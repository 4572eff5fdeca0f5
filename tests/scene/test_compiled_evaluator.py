"""A batch of attempts that ends with the time; what the kernels do is tested with each of them."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.evaluator import Attempts, AttemptStatus
from gpis_grasp_planner.grasp.funnel import Step
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.grasp.tally import Tally
from gpis_grasp_planner.hand.description import HandDescription, load_hand
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.search_space import PalmSearchSpace

N = 50


class Clock:
    """Says that the time is over at the n-th look."""

    def __init__(self, looks: int):
        self.looks, self.asked = looks, 0

    def __call__(self) -> bool:
        self.asked += 1
        return self.asked >= self.looks


@pytest.fixture(scope="module", params=["barrett_bh280", "parallel_jaw"])
def hand(request: pytest.FixtureRequest) -> HandDescription:
    return load_hand(request.param)


def attempts_with(
    hand: HandDescription, clock: Clock, from_postures: bool
) -> tuple[Attempts, CompiledEvaluator]:
    part = MeshCatalogue([default_catalogue_directory()]).load("sphere")
    settings = SceneSettings(field_cells=40)
    evaluator = CompiledEvaluator(hand, part, Friction(0.6, 0.4), settings, ended=clock)
    rng = np.random.default_rng(3)
    space = PalmSearchSpace(part.mesh.bounds, 0.06)
    T, spread = space.poses(space.domain.sample(N, rng)), np.zeros((N, 1))
    T[:, :3, 3] = 0.3 * T[:, :3, 3] - 0.08 * T[:, :3, 2]
    T, _ = evaluator.clear_palm(T, -T[:, :3, 2], spread, np.zeros(N))
    if from_postures:
        return evaluator.attempt_from(T, np.zeros((N, hand.n_joints))), evaluator
    return evaluator.attempt(T, spread), evaluator


@pytest.mark.parametrize("from_postures", [False, True])
@pytest.mark.parametrize("looks", [1, 2, 3])
def test_what_was_begun_is_whole_and_the_rest_is_said_to_be_untried(
    hand: HandDescription, from_postures: bool, looks: int
) -> None:
    whole, all_tried = attempts_with(hand, Clock(1000), from_postures)
    assert all_tried.n_attempts == N
    assert (whole.status != AttemptStatus.NOT_TRIED).all()
    assert (whole.epsilon > 0.0).any()
    cut, evaluator = attempts_with(hand, Clock(looks), from_postures)
    n = 16 * looks
    assert evaluator.n_attempts == n
    for field in fields(cut):
        values, expected = getattr(cut, field.name), getattr(whole, field.name)
        if isinstance(values, np.ndarray) and field.name != "T_object_palm":
            np.testing.assert_array_equal(values[:n], expected[:n], err_msg=field.name)
    assert (cut.status[n:] == AttemptStatus.NOT_TRIED).all()
    assert (cut.epsilon[n:] == -1.0).all()
    tally = Tally()
    tally.propose(cut)
    assert tally.funnel(Step.FORCE_CLOSURE).proposed == n
