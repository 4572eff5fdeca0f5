"""The page on hands: its least description is one that plans."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from hand_models import box_link, joint_about

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.hand.checks import faults_of
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings

ENDS = (0.0, 1.3963)
PAGE = Path(__file__).resolve().parents[2] / "docs/hands.md"


def test_the_least_description_of_a_hand_plans(tmp_path, catalogue):
    [text] = re.findall(r"```yaml\n(name: my_hand.*?)```", PAGE.read_text(), re.DOTALL)
    lean = 'rpy="1.5707963 -1.3'
    parts = [box_link("palm", (0.1, 0.06, 0.05), (0.0, 0.0, 0.025))]
    for finger, (x, turn) in {"left": (0.045, 0.0), "right": (-0.045, np.pi)}.items():
        inner, outer = f"{finger}_inner", f"{finger}_outer"
        parts += [
            box_link(inner, (0.06, 0.014, 0.018), (0.03, 0.0, 0.0)),
            joint_about(inner, "palm", f'xyz="{x} 0 0.055" {lean} {turn}"', ENDS),
            box_link(outer, (0.045, 0.012, 0.018), (0.0225, 0.0, 0.0)),
            joint_about(outer, inner, 'xyz="0.06 0 0"', ENDS),
        ]
    (tmp_path / "my_hand.urdf").write_text(f'<robot name="my_hand">{"".join(parts)}</robot>')
    path = tmp_path / "my_hand.yaml"
    path.write_text(text)
    assert faults_of(load_hand(str(path))) == []
    planner = GraspPlanner(PlannerSettings(hand=HandSettings(model=str(path))))
    request = PlanRequest(
        time_budget_s=600.0,
        max_evaluations=400,
        verification="none",
        friction=Friction(0.6, 0.6),
        n_grasps=3,
        seed=1,
    )
    result = planner.answer(catalogue.load("coupling_hub"), request).result
    print(result.code.name, [grasp.epsilon for grasp in result.grasps])
    assert result.grasps
