"""A URDF's <mimic> and the hand's description must move joints alike."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.checks import faults_of
from gpis_grasp_planner.hand.description import load_hand


def copied(name: str, folder: Path) -> tuple[Path, Path]:
    hand = load_hand(name)
    shutil.copytree(hand.yaml_path.parent, folder / "hand")
    return folder / "hand" / hand.yaml_path.name, folder / "hand" / hand.urdf_path.name


@pytest.mark.parametrize(
    ("hand", "old", "new", "said"),
    [
        (
            "barrett_bh280",
            '<mimic joint="bh_j12_joint" multiplier="0.333333333333" />',
            '<mimic joint="bh_j12_joint" multiplier="0.5" />',
            "'bh_j13_joint' follows 'bh_j12_joint' times 0.5, but .* 0.333333 goes with 1",
        ),
        (
            "barrett_bh280",
            '<mimic joint="bh_j12_joint" multiplier="0.333333333333" />',
            '<mimic joint="bh_j12_joint" multiplier="0.333333333333" offset="0.1" />',
            "joint 2 would go to 0.814487, but its stop is at 0.737758",
        ),
        (
            "barrett_bh280",
            '<mimic joint="bh_j12_joint" multiplier="0.333333333333" />',
            '<mimic joint="bh_j22_joint" multiplier="0.333333333333" />',
            "a joint of another finger",
        ),
        (
            "barrett_bh280",
            '<mimic joint="bh_j11_joint" multiplier="1" />',
            '<mimic joint="bh_j11_joint" multiplier="-1" />',
            r"gains of the pre-shape's motors are \[1.0\] and \[1.0\]",
        ),
        (
            "barrett_bh280",
            '<mimic joint="bh_j11_joint" multiplier="1" />',
            '<mimic joint="bh_j12_joint" multiplier="1" />',
            "only one of them closes by the description",
        ),
        (
            "barrett_bh280",
            '<mimic joint="bh_j11_joint" multiplier="1" />',
            '<mimic joint="nowhere" multiplier="1" />',
            "mimics 'nowhere', which is none of its movable joints",
        ),
        (
            "parallel_jaw",
            '<mimic joint="left_jaw_joint" multiplier="1"/>',
            '<mimic joint="left_jaw_joint" multiplier="0.5"/>',
            "a joint of another finger",
        ),
    ],
)
def test_a_urdf_that_couples_otherwise_is_refused(tmp_path, hand, old, new, said):
    yaml_path, urdf_path = copied(hand, tmp_path)
    text = urdf_path.read_text()
    assert old in text
    urdf_path.write_text(text.replace(old, new, 1))
    with pytest.raises(RequestError, match=said):
        load_hand(str(yaml_path))


def test_joints_that_follow_as_the_description_says_are_accepted(tmp_path):
    yaml_path, _ = copied("barrett_bh280", tmp_path)
    mimics = [m for m in load_hand(str(yaml_path)).joint_mimic if m is not None]
    assert [round(multiplier, 6) for _, multiplier, _ in mimics] == [1.0] + [0.333333] * 3


def test_a_joint_that_follows_for_good_and_is_moved_on_alone_is_told(tmp_path):
    """Without a breakaway the URDF's coupling and the closing table contradict each other."""
    yaml_path, _ = copied("barrett_bh280", tmp_path)
    assert faults_of(load_hand(str(yaml_path))) == []
    text = yaml_path.read_text()
    assert "breakaway_torque: 0.55" in text
    yaml_path.write_text(text.replace("breakaway_torque: 0.55", "breakaway_torque: 0"))
    load_hand.cache_clear()
    faults = faults_of(load_hand(str(yaml_path)))
    assert len(faults) == 3
    assert "'bh_j13_joint' always follows 'bh_j12_joint'" in faults[0]
    assert "'breakaway_torque'" in faults[0]
