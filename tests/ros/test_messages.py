"""The interface package says what the code says."""

from __future__ import annotations

import pytest

from gpis_grasp_msgs.action import PlanGrasp as PlanGraspAction
from gpis_grasp_msgs.msg import Grasp
from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode


@pytest.mark.parametrize("answer", [PlanGrasp.Response, PlanGraspAction.Result])
def test_the_codes_are_those_of_the_errors(answer: type) -> None:
    names = [name for name in dir(type(answer)) if name.isupper()]
    constants = {name: getattr(answer, name) for name in names if not name.startswith("_")}
    constants = {k: v for k, v in constants.items() if isinstance(v, int)}
    assert constants == {code.name: int(code) for code in ErrorCode}


def test_service_and_action_ask_and_answer_the_same() -> None:
    for one, other in (
        (PlanGrasp.Request, PlanGraspAction.Goal),
        (PlanGrasp.Response, PlanGraspAction.Result),
    ):
        assert one.get_fields_and_field_types() == other.get_fields_and_field_types()
        for field in one.get_fields_and_field_types():
            assert getattr(one(), field) == getattr(other(), field)


def test_a_request_nobody_filled_in_asks_for_the_defaults() -> None:
    request = PlanGrasp.Request()
    assert (request.seed, request.time_budget, request.n_grasps, request.planner) == (-1, 0, 0, "")
    assert request.object_pose.header.frame_id == ""


def test_a_grasp_claims_no_hold_probability_by_itself() -> None:
    assert Grasp().hold_probability == -1.0
    assert not Grasp().verification.attempted
