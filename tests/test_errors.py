"""Error codes are in the range of their class, and every error says its text and code."""

import pytest

from gpis_grasp_planner.errors import (
    ErrorCode,
    GraspPlannerError,
    MeshError,
    PlanningError,
    PoseError,
    RequestError,
    SystemFault,
)

RANGES = {RequestError: 1, MeshError: 2, PoseError: 3, PlanningError: 4, SystemFault: 5}


@pytest.mark.parametrize("kind", RANGES)
def test_default_code_is_in_the_range_of_its_class(kind):
    error = kind("what, value, limit, next step")
    assert isinstance(error, GraspPlannerError)
    assert error.code // 100 == RANGES[kind]
    assert error.message == str(error) == "what, value, limit, next step"


def test_codes_are_unique_and_stay_what_the_service_promised():
    values = [code.value for code in ErrorCode.__members__.values()]
    assert len(values) == len(set(values))
    assert ErrorCode.SUCCESS == 0
    assert {value // 100 for value in values if value} == {1, 2, 3, 4, 5}
    promised = {"INVALID_MESH_ID": 100, "UNKNOWN_MESH": 101, "MESH_UNREADABLE": 200,
                "NO_POSE_ESTIMATE": 300, "NO_FEASIBLE_GRASP": 400, "BUSY": 500}  # fmt: skip
    assert {name: ErrorCode[name].value for name in promised} == promised


def test_a_given_code_overrides_for_that_error_alone():
    assert MeshError("x", ErrorCode.MESH_EMPTY).code is ErrorCode.MESH_EMPTY
    assert MeshError("x").code is ErrorCode.MESH_UNREADABLE


def test_caught_by_the_base_class():
    with pytest.raises(GraspPlannerError, match="too small"):
        raise RequestError("The budget is too small.")
