from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

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
    assert [m["name"] for m in facts["motors"]] == [*hand.preshape.names, *hand.drive.motor_names]


def test_facts_for_people(gpis_grasp) -> None:
    answer = gpis_grasp("hand")
    assert all(name in answer.out for name in load_hand().joint_names)


def test_an_unknown_hand(gpis_grasp) -> None:
    answer = gpis_grasp("hand", "--name", "shadow")
    assert answer.code == 1
    assert "barrett_bh280" in answer.err


def test_the_list_names_the_default_and_the_gripper(gpis_grasp) -> None:
    lines = gpis_grasp("hand", "list").out.splitlines()
    assert "barrett_bh280 (default)" in lines
    assert {"parallel_jaw", "three_finger_adaptive", "four_finger_16"} <= set(lines)


def test_a_good_hand_passes_and_a_bad_one_is_explained(gpis_grasp, tmp_path) -> None:
    answer = gpis_grasp("hand", "check", "parallel_jaw")
    assert answer.code == 0
    assert "2 fingers of 1 link, pre-shape: none" in answer.out
    hand = load_hand("parallel_jaw")
    text = hand.yaml_path.read_text().replace("[0.0, 0.0, 40.0]", "[0.0, 5.0, 140.0]")
    (tmp_path / "bad.yaml").write_text(text)
    (tmp_path / hand.urdf_path.name).write_text(hand.urdf_path.read_text())
    answer = gpis_grasp("hand", "check", str(tmp_path / "bad.yaml"))
    assert answer.code == 1
    assert "left_jaw_link" in answer.err
    assert "on the surface" in answer.err
    answer = gpis_grasp("hand", "check", str(tmp_path / "none.yaml"))
    assert answer.code == 1
    assert "Cannot read the hand" in answer.err


def test_a_picture_of_a_hand(gpis_grasp, tmp_path) -> None:
    path = tmp_path / "jaw.png"
    answer = gpis_grasp("hand", "show", "parallel_jaw", "--picture", str(path))
    assert answer.code == 0
    with Image.open(path) as image:
        assert image.size == (3 * 480, 360)


def test_each_action_speaks_json(gpis_grasp, tmp_path) -> None:
    names = json.loads(gpis_grasp("hand", "list", "--json").out)
    assert names["default"] in names["hands"]
    checked = json.loads(gpis_grasp("hand", "check", "parallel_jaw", "--json").out)
    assert checked == {"name": "parallel_jaw", "faults": []}
    path = tmp_path / "jaw.png"
    drawn = gpis_grasp("hand", "show", "parallel_jaw", "--picture", path, "--json")
    assert json.loads(drawn.out) == {"picture": str(path), "name": "parallel_jaw"}


@pytest.mark.parametrize(
    "words",
    [
        ("list", "parallel_jaw"),
        ("check", "--urdf"),
        ("facts", "--picture", "a.png"),
        ("check", "parallel_jaw", "--name", "barrett_bh280"),
    ],
)
def test_what_an_action_does_not_use_is_refused(gpis_grasp, words) -> None:
    answer = gpis_grasp("hand", *words)
    assert answer.code == 1
    assert not answer.out
    assert answer.err.startswith("gpis-grasp: error: ")
