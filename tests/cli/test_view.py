"""What 'view' says where it cannot show anything; the page itself is in tests/view/test_page.py."""

import json
import subprocess
import sys

import pytest


def test_without_viser_it_says_what_to_install(gpis_grasp, monkeypatch):
    monkeypatch.setitem(sys.modules, "viser", None)
    answer = gpis_grasp("view", "mug")
    assert answer.code == 1
    assert answer.out == ""
    assert "pip install 'gpis-grasp-planner[view]'" in answer.err


def test_a_document_is_not_planned(gpis_grasp):
    answer = gpis_grasp("view", "grasps.json", "--live")
    assert answer.code == 1
    assert "Name a mesh" in answer.err


def test_a_document_that_is_not_there(gpis_grasp, tmp_path):
    answer = gpis_grasp("view", tmp_path / "grasps.json")
    assert answer.code == 1
    assert "grasps.json" in answer.err


@pytest.mark.parametrize("words", [(), ("mug", "--ros")])
def test_either_a_part_or_a_node_is_shown(gpis_grasp, words):
    answer = gpis_grasp("view", *words)
    assert answer.code == 1
    assert "either a part, or a document, or --ros" in answer.err


def test_without_ros_it_says_what_to_source(gpis_grasp, monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.delitem(sys.modules, "gpis_grasp_planner.ros.grasp_watch", raising=False)
    answer = gpis_grasp("view", "--ros")
    assert answer.code == 1
    assert "rclpy is not there" in answer.err
    assert "scripts/env.sh" in answer.err


def test_a_program_reads_the_address_from_one_line_of_json():
    from terminal_sessions import PROGRAM, environment

    with subprocess.Popen(
        [*PROGRAM, "view", "mug", "--json", "--port", "8331"],
        env=environment(),
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        said = json.loads(process.stdout.readline())
        process.terminate()
        assert process.wait(30.0) == 0
    assert said["shows"] == "mug"
    assert said["address"].startswith("http://127.0.0.1:")
