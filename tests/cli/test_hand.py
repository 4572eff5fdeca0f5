from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from gpis_grasp_planner.hand.description import load_hand


def test_urdf_prints_the_path_alone(gpis_grasp) -> None:
    answer = gpis_grasp("hand", "--urdf")
    assert answer.code == 0
    path = Path(answer.out.removesuffix("\n"))
    assert path == load_hand().urdf_path
    assert path.is_file()


def test_facts_as_json(gpis_grasp) -> None:
    hand, facts = load_hand(), json.loads(gpis_grasp("hand", "--json").out)
    assert [j["name"] for j in facts["joints"]] == list(hand.joint_names)
    np.testing.assert_array_equal([j["upper"] for j in facts["joints"]], hand.joint_upper)
    assert [link["friction_group"] for link in facts["links"]] == list(hand.link_friction_group)
    assert [m["name"] for m in facts["motors"]] == list(hand.drive.motor_names)


def test_facts_for_people(gpis_grasp) -> None:
    answer = gpis_grasp("hand")
    assert all(name in answer.out for name in load_hand().joint_names)


def test_an_unknown_hand(gpis_grasp) -> None:
    answer = gpis_grasp("hand", "--name", "shadow")
    assert answer.code == 1
    assert "barrett_bh280" in answer.err
