"""Which sections of a parameter file are for a node: as ROS itself takes them."""

from __future__ import annotations

from pathlib import Path

import pytest
from rclpy.node import Node
from real_node import real_node

from gpis_grasp_planner.ros.parameter_sections import (
    is_for,
    parameter_files,
    passed_over,
    sections_of,
)

VALUES = "{ros__parameters: {queue_size: 5}}"
FILES = {
    "plain": f"grasp_planner: {VALUES}",
    "slash": f"/grasp_planner: {VALUES}",
    "all": f"/**: {VALUES}",
    "one": f"/*: {VALUES}",
    "nested": f"cell1: {{grasp_planner: {VALUES}}}",
    "written out": f"/cell1/grasp_planner: {VALUES}",
    "without a slash": f"cell1/grasp_planner: {VALUES}",
    "any namespace": f"/*/grasp_planner: {VALUES}",
    "any namespaces": f"/**/grasp_planner: {VALUES}",
    "any node there": f"/cell1/*: {VALUES}",
    "nested in all": f"/**: {{grasp_planner: {VALUES}}}",
    "another": f"planner: {VALUES}",
    "another beside it": f"planner: {VALUES}\ngrasp_planner: {VALUES}",
    "below": f"/**/cell1/grasp_planner: {VALUES}",
}


@pytest.mark.parametrize("namespace", ["/", "/cell1", "/hall/cell1"])
@pytest.mark.parametrize("kind", FILES)
def test_a_section_is_for_the_node_that_ros_gives_it_to(
    kind: str, namespace: str, tmp_path: Path
) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(FILES[kind])
    arguments = f"--params-file {file}"
    with real_node(lambda c: Node("grasp_planner", namespace=namespace, context=c), arguments) as n:
        given = "queue_size" in n._parameter_overrides
        name = n.get_fully_qualified_name()
        assert any(is_for(section, name) for section in sections_of(str(file))) == given
        told = passed_over(["node", "--ros-args", *arguments.split()], name)
        assert bool(told) != given
        if told:
            assert name in told[0]
            assert "cell.yaml" in told[0]
            assert str(tmp_path) not in told[0]


def test_files_are_those_that_ros_reads() -> None:
    arguments = "node --params-file a --ros-args --params-file b -p x:=1 -- --params-file c"
    assert parameter_files(arguments.split()) == ["b"]
    assert parameter_files(["node", "--ros-args", "--params-file"]) == []


@pytest.mark.parametrize("text", ["", "5", "- a", "a: [", "grasp_planner: 5"])
def test_what_has_no_sections_is_left_to_ros(text: str, tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(text)
    assert sections_of(str(file)) == []
    assert sections_of(str(tmp_path / "none.yaml")) == []
