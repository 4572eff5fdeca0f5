"""What is made once per mesh."""

from __future__ import annotations

from gpis_grasp_planner.plan.preparation import Preparation
from gpis_grasp_planner.plan.settings import PlannerSettings


def test_a_part_is_prepared_once(sphere):
    preparation = Preparation(PlannerSettings())
    assert preparation.of(sphere) is preparation.of(sphere)
