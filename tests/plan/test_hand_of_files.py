"""A hand that is written here, of files alone: four fingers of four links, no pre-shape."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hand_models import box_link, held_in_both_engines, joint_about

from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.hand.checks import faults_of
from gpis_grasp_planner.hand.drive import joints_from_motors, reachable
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings

LENGTHS = (0.040, 0.034, 0.028, 0.026)  # of the links [m]
UPPER = (1.5, 1.2, 1.0, 0.8)  # rad; each joint's ratio to the first is that of its limits
CORNERS = {"a": (30, 26, 0), "b": (-30, 26, 180), "c": (30, -26, 0), "d": (-30, -26, 180)}


def write_hand(folder: Path) -> Path:
    """The URDF and the YAML file; fingers lean out by 0.5 rad and close towards the other side."""
    parts = [box_link("palm", (0.08, 0.09, 0.05), (0.0, 0.0, 0.025))]
    for finger, (x, y, turn) in CORNERS.items():
        parent = "palm"
        # x of a link's frame along the link, y out of its pad, z along the joint
        origin = f'xyz="{x / 1000} {y / 1000} 0.055" rpy="1.5707963 -1.0707963 {np.radians(turn)}"'
        for number, (length, upper) in enumerate(zip(LENGTHS, UPPER, strict=True)):
            link = f"{finger}{number}"
            parts += [
                box_link(link, (length, 0.014, 0.018), (0.5 * length, 0.0, 0.0)),
                joint_about(link, parent, origin, (0.0, upper)),
            ]
            parent, origin = link, f'xyz="{length} 0 0"'
    (folder / "mine.urdf").write_text(f'<robot name="mine">{"".join(parts)}</robot>')
    pads = [
        [{"point_mm": [500.0 * length, 7.0, 0.0], "normal": [0.0, 1.0, 0.0]}] for length in LENGTHS
    ]
    rows = [[0.0] * h + [u / UPPER[h] for u in UPPER[h:]] for h in range(len(UPPER))]
    description = {
        "name": "mine",
        "urdf": "mine.urdf",
        "palm_link": "palm",
        "palm_friction_links": ["palm"],
        "fingers": [{"name": f, "joints": [f"{f}{k}_joint" for k in range(4)]} for f in CORNERS],
        "drive": {
            "motor_names": [*CORNERS],
            "motor_upper_deg": [float(np.degrees(UPPER[0]))] * 4,
            "full_travel_s": [1.0] * 4,
            "closing_rows": rows,
            "independent": True,
            "breakaway_torque": 0.3,
            "tip_force_n": 10,
            "tip_point_mm": [22.0, 7.0, 0.0],
        },
        "eigengrasps": {
            "origin": [0.0] * 4,
            "amplitude_limit": 1.5,
            "directions": [[1.0, 1.0, 1.0, 1.0]],
        },
        "desired_contacts": {"palm": [], "links": pads},
    }
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(description))
    return path


@pytest.fixture(scope="module")
def planner(tmp_path_factory):
    path = write_hand(tmp_path_factory.mktemp("hand"))
    return GraspPlanner(PlannerSettings(hand=HandSettings(model=str(path))))


def test_it_is_read_without_a_fault_and_closes_by_its_table(planner):
    hand = planner.hand
    assert faults_of(hand) == []
    assert hand.drive.n_links == 4
    joints = joints_from_motors(hand, np.zeros((1, 0)), np.full((1, 4), 0.6))
    np.testing.assert_allclose(hand.of_fingers(joints[0]), 0.4 * np.tile(UPPER, (4, 1)))


def test_it_plans_and_is_tried_in_both_engines(planner, catalogue):
    part = catalogue.load("bracket")
    request = PlanRequest(
        time_budget_s=600.0,
        max_evaluations=500,
        n_grasps=4,
        friction=Friction(0.6, 0.6),
        verification="none",
        seed=2,
    )
    result = planner.answer(part, request).result
    assert result.grasps
    for grasp in result.grasps:
        assert grasp.epsilon > 0.0
        assert reachable(planner.hand, grasp.joints).all()
    held_in_both_engines(part, planner.hand, result.grasps)
