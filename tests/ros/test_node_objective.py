"""What a good grasp is, chosen by a request, and all figures of a grasp in its message."""

from __future__ import annotations

from typing import Any

import pytest

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.quality.figures import EPSILON, VOLUME

TASK = "lift 0 0 1"


def test_a_grasp_carries_all_its_figures(planned: PlanGrasp.Response) -> None:
    assert planned.objective == "epsilon + 0.5 volume"
    for grasp in planned.grasps:
        figures = {figure.name: figure for figure in grasp.figures}
        assert {"epsilon", "volume", "imbalance", "min_weight", "least_friction"} <= set(figures)
        assert figures[EPSILON.name].value == grasp.epsilon
        assert figures[VOLUME.name].value == grasp.volume
        assert figures["epsilon"].larger_is_better
        assert not figures["least_friction"].larger_is_better


@pytest.mark.parametrize("asked", [{"task": TASK}, {"objective": "task", "task": TASK}])
def test_a_request_chooses_its_objective(
    client: Any, planned: PlanGrasp.Response, tools: Any, asked: dict[str, str]
) -> None:
    answer = client.call(tools.request("mug", time_budget=2.0, verification="none", **asked))
    assert answer.success, answer.message
    assert answer.objective == "task"
    tasks = [{f.name: f.value for f in grasp.figures}["task"] for grasp in answer.grasps]
    assert min(tasks) > 0.0
    again = client.call(tools.request("mug", time_budget=2.0, verification="none", **asked))
    assert again.from_cache
    assert again.objective == "task"


def test_an_unknown_objective_is_refused_with_the_known_ones(
    client: Any, planned: PlanGrasp.Response, tools: Any
) -> None:
    answer = client.call(tools.request("mug", objective="nonsense"))
    assert answer.code == ErrorCode.INVALID_SETTING
    assert "no objective 'nonsense'; known are paper, min_weight" in answer.message
