"""A node for another hand than the default."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def test_the_parameter_chooses_the_hand_and_cannot_change(
    client: Any, start_node: Callable[..., Any]
) -> None:
    node = start_node({"hand.model": "parallel_jaw"})
    node.wait_ready()
    assert "hand parallel_jaw" in node.text()
    response = client.plan("coupling_hub", time_budget=10.0, n_grasps=3)
    assert response.success, response.message
    for grasp in response.grasps:
        assert list(grasp.grasp.name) == ["left_jaw_joint", "right_jaw_joint"]
        assert grasp.grasp.position[0] == grasp.grasp.position[1]
        assert 0.0 < grasp.grasp.position[0] < 0.0425
        assert len(grasp.pre_grasp.position) == 2
    assert node.end() == 0


def test_an_unknown_hand_ends_the_start_with_the_known_ones(
    start_node: Callable[..., Any],
) -> None:
    node = start_node({"hand.model": "claw"})
    assert node.process.wait(60.0) != 0
    assert "Unknown hand 'claw'" in node.text()
    assert "parallel_jaw" in node.text()
