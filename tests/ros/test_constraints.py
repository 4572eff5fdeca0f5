"""Approach cones and forbidden regions of a request."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3, Vector3Stamped
from std_msgs.msg import Header

from gpis_grasp_msgs.msg import ForbiddenRegion
from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.ros.constraints import approach_of, forbidden_of
from gpis_grasp_planner.ros.request_guard import ObjectPose

HALF = math.sqrt(0.5)
POSE = ObjectPose(np.eye(4), "cell", 7, None, ())


def request(frame: str, xyz: Any = (0, 0, -1), angle: float = 0.5) -> PlanGrasp.Request:
    x, y, z = map(float, xyz)
    axis = Vector3Stamped(header=Header(frame_id=frame), vector=Vector3(x=x, y=y, z=z))
    return PlanGrasp.Request(approach_axis=axis, approach_half_angle=angle)


def quarter_turn(target: str, source: str, stamp_ns: int) -> np.ndarray:
    assert (target, source, stamp_ns) == ("cell", "base", 7)
    return from_position_quat_xyzw([9, 9, 9], [HALF, 0, 0, HALF])  # about x


def test_nothing_asked_is_no_limit() -> None:
    assert approach_of(PlanGrasp.Request(), POSE, quarter_turn) is None
    assert forbidden_of(PlanGrasp.Request()) == ()


@pytest.mark.parametrize(
    ("frame", "axis", "of"),
    [("", (0, 0, -1), "object"), ("cell", (0, 0, -1), "world"), ("base", (0, 1, 0), "world")],
)
def test_the_cone_is_in_the_parts_frame_or_the_poses(frame: str, axis: Any, of: str) -> None:
    cone = approach_of(request(frame), POSE, quarter_turn)
    assert cone is not None
    assert cone.frame == of
    assert cone.half_angle_deg == pytest.approx(math.degrees(0.5))
    np.testing.assert_allclose(cone.axis, axis, atol=1e-12)


@pytest.mark.parametrize("angle", [0.0, -0.1, 3.2, math.nan, math.inf])
def test_an_axis_without_a_proper_angle_is_refused_not_ignored(angle: float) -> None:
    with pytest.raises(RequestError, match="approach_half_angle") as caught:
        approach_of(request("cell", angle=angle), POSE, quarter_turn)
    assert caught.value.code == ErrorCode.INVALID_SCENE


def test_an_angle_without_an_axis_is_refused() -> None:
    with pytest.raises(RequestError, match="axis"):
        approach_of(request("", (0, 0, 0)), POSE, quarter_turn)


def test_a_forbidden_region_is_taken_as_it_is_and_a_bad_one_named() -> None:
    region = ForbiddenRegion(
        name="thread",
        pose=Pose(position=Point(x=0.1), orientation=Quaternion(w=1.0)),
        size=Vector3(x=0.1, y=0.2, z=0.3),
        margin=0.005,
    )
    [taken] = forbidden_of(PlanGrasp.Request(forbidden_regions=[region]))
    assert (taken.name, taken.margin_m) == ("thread", 0.005)
    np.testing.assert_allclose(taken.size, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(taken.pose[:3, 3], [0.1, 0, 0])
    assert ForbiddenRegion().margin == 0.002
    region.margin = 5.0
    with pytest.raises(RequestError, match="thread") as caught:
        forbidden_of(PlanGrasp.Request(forbidden_regions=[region]))
    assert caught.value.code == ErrorCode.INVALID_SCENE
