"""A hand without a pre-shape is searched without coordinates for it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.objective import EpsilonVolume
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.admm_cp_opt import ContactPointOptimiser
from gpis_grasp_planner.search.archive import GraspArchive
from gpis_grasp_planner.search.contacts.grips import pinches
from gpis_grasp_planner.search.context import PlanningContext
from gpis_grasp_planner.search.hpp_opt import PalmPoseOptimiser


@pytest.fixture
def context(catalogue):
    settings = PlannerSettings(hand=HandSettings(model="parallel_jaw"))
    planner, part = GraspPlanner(settings), catalogue.load("bracket")
    prepared, hand = planner.prepare(part), planner.hand
    friction = Friction(0.6, 0.6)
    return PlanningContext(
        part=part,
        hand=hand,
        evaluator=CompiledEvaluator(
            hand, part, friction, settings.scene, prepared.field, prepared.tree
        ),
        atlas=prepared.atlas,
        archive=GraspArchive(part.max_radius, EpsilonVolume(settings.hpp.volume_weight)),
        settings=settings.search,
        rng=np.random.default_rng(3),
    )


def test_the_model_has_the_palm_and_the_standoff(context):
    search = PalmPoseOptimiser(context)
    assert_allclose(search.space.domain.upper[6:], [context.settings.adaption.standoff_max_m])
    proposals = search.propose(8)
    assert proposals.X.shape == (8, 7)
    assert proposals.posture.shape == (8, 1)
    assert proposals.attempts.preshape.shape[1] == 0
    assert (proposals.best >= 0).any()
    search.tell(proposals)
    search.tell_attempts(proposals.attempts, np.arange(len(proposals.attempts)) // 4)
    assert search.propose(2).X.shape == (2, 7)


def test_its_grips_are_there_once(context):
    table = pinches(context.hand, 0.0)
    rows = np.column_stack([table.joints, table.middle, table.axis, table.width])
    assert len(np.unique(rows.round(12), axis=0)) == len(rows)
    assert table.preshape.shape == (len(rows), 0)


def test_contact_points_are_optimised_over_the_motors_that_move(context):
    search = PalmPoseOptimiser(context)
    proposals = search.propose(24)
    best = proposals.best[int(np.argmax(proposals.values))]
    assert best >= 0
    optimiser = ContactPointOptimiser(context)
    T, joints = proposals.attempts.T_object_palm[best], proposals.attempts.joints[best]
    scaled = np.array([[0.2, 0.2], [0.8, 0.8]])
    assert optimiser.quality(T, scaled).shape == (2,)
    result = optimiser.optimise(T, joints)[0]
    assert result.admm.z.shape == (2,)
    assert result.motors.shape == (2,)
