"""The page on hands: its least description is one that plans."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.hand.checks import faults_of
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings

PAGE = Path(__file__).resolve().parents[2] / "docs/hands.md"


def _link(name: str, size: str, center: str) -> str:
    return (
        f'<link name="{name}"><inertial><mass value="0.05"/></inertial><collision>'
        f'<origin xyz="{center}"/><geometry><box size="{size}"/></geometry></collision></link>'
    )


def _joint(name: str, parent: str, origin: str) -> str:
    return (
        f'<joint name="{name}_joint" type="revolute"><parent link="{parent}"/>'
        f'<child link="{name}"/><origin {origin}/><axis xyz="0 0 1"/>'
        '<limit lower="0" upper="1.3963" velocity="3" effort="4"/></joint>'
    )


def test_the_least_description_of_a_hand_plans(tmp_path, catalogue):
    [text] = re.findall(r"```yaml\n(name: my_hand.*?)```", PAGE.read_text(), re.DOTALL)
    parts = [_link("palm", "0.1 0.06 0.05", "0 0 0.025")]
    for finger, (x, turn) in {"left": (0.045, 0.0), "right": (-0.045, np.pi)}.items():
        inner, outer = f"{finger}_inner", f"{finger}_outer"
        parts += [
            _link(inner, "0.06 0.014 0.018", "0.03 0 0"),
            _joint(inner, "palm", f'xyz="{x} 0 0.055" rpy="1.5707963 -1.3 {turn}"'),
            _link(outer, "0.045 0.012 0.018", "0.0225 0 0"),
            _joint(outer, inner, 'xyz="0.06 0 0"'),
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
