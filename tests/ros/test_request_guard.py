"""Rules for requests and poses, each with its code and the figures in its message."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.ros.request_guard import (
    NANOSECONDS,
    RawPose,
    check_pose,
    check_request,
)
from gpis_grasp_planner.ros.settings import PLANNER_NAMES, NodeSettings

SETTINGS = NodeSettings(max_pose_age_s=2.0, max_pose_ahead_s=0.5, max_time_budget_s=60.0)
NOW_S = 1_000
NOW_NS = NOW_S * NANOSECONDS
STEADY_S = 50.0
GOOD = RawPose(
    source="the estimate",
    frame_id="camera",
    stamp_sec=NOW_S - 1,
    stamp_nanosec=0,
    position=(0.1, -0.2, 0.3),
    quat_xyzw=(0.0, 0.0, 0.0, 1.0),
    covariance=None,
    arrival_ns=NOW_NS - NANOSECONDS // 2,
    arrival_steady_s=STEADY_S - 0.5,
)


def refusal(**changes: object) -> GraspPlannerError:
    with pytest.raises(GraspPlannerError) as caught:
        check_pose(replace(GOOD, **changes), NOW_NS, STEADY_S, SETTINGS)
    return caught.value


def test_a_good_pose_comes_through() -> None:
    pose = check_pose(GOOD, NOW_NS, STEADY_S, SETTINGS)
    expected = np.eye(4)
    expected[:3, 3] = GOOD.position
    assert np.array_equal(pose.T_world_object, expected)
    assert pose.frame_id == "camera"
    assert pose.stamp_ns == (NOW_S - 1) * NANOSECONDS
    assert pose.covariance is None
    assert pose.notes == ()


@pytest.mark.parametrize(
    "changes",
    [
        {"stamp_nanosec": 1},
        {"frame_id": "cell"},
        {"position": (0.1, -0.2, 0.3000001)},
        {"covariance": tuple(np.diag([1e-6] * 6).ravel())},
    ],
)
def test_one_estimate_is_told_from_the_next(changes: dict[str, object]) -> None:
    pose = check_pose(GOOD, NOW_NS, STEADY_S, SETTINGS)
    other = check_pose(replace(GOOD, **changes), NOW_NS, STEADY_S, SETTINGS)
    assert pose.same_as(check_pose(GOOD, NOW_NS, STEADY_S, SETTINGS))
    assert other.same_as(replace(other))
    assert not pose.same_as(other)
    assert not other.same_as(pose)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("index", range(7))
def test_every_number_must_be_finite(bad: float, index: int) -> None:
    values = [*GOOD.position, *GOOD.quat_xyzw]
    values[index] = bad
    error = refusal(position=tuple(values[:3]), quat_xyzw=tuple(values[3:]))
    assert error.code == ErrorCode.POSE_NOT_FINITE
    assert str(bad) in error.message


def test_an_absurd_position_is_refused() -> None:
    error = refusal(position=(1e38, 0.0, 0.0))
    assert error.code == ErrorCode.POSE_NOT_FINITE
    assert "1e+38" in error.message
    assert "1e+06" in error.message


@pytest.mark.parametrize(
    ("quat", "norm"),
    [((0.0, 0.0, 0.0, 0.0), "0"), ((0.0, 0.0, 0.0, 1.002), "1.002"), ((0, 0, 0.998, 0), "0.998")],
)
def test_a_quaternion_far_from_unit_is_refused(quat: tuple[float, ...], norm: str) -> None:
    error = refusal(quat_xyzw=quat)
    assert error.code == ErrorCode.INVALID_QUATERNION
    assert f"norm {norm};" in error.message
    assert "0.001" in error.message


@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.floats(0.9991, 1.0009),
)
def test_a_nearly_unit_quaternion_is_normalised_and_its_sign_is_free(
    q: tuple[float, ...], norm: float
) -> None:
    unit = np.array(q) / np.linalg.norm(q)
    poses = [
        check_pose(replace(GOOD, quat_xyzw=tuple(s * unit)), NOW_NS, STEADY_S, SETTINGS)
        for s in (1.0, -1.0, norm, -norm)
    ]
    R = poses[0].T_world_object[:3, :3]
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-14)
    for pose in poses[1:]:
        assert np.allclose(pose.T_world_object, poses[0].T_world_object, atol=1e-14)
    assert bool(poses[2].notes) == (abs(norm - 1.0) > 1e-6)


@pytest.mark.parametrize("frame", ["", " ", "a b", "x\ny", "f" * 256, "\x00"])
def test_a_frame_must_have_a_usable_name(frame: str) -> None:
    error = refusal(frame_id=frame)
    assert error.code == ErrorCode.EMPTY_FRAME
    assert "\n" not in error.message
    assert "\x00" not in error.message


@pytest.mark.parametrize("frame", ["map", "camera_color_optical_frame", "robot1/base_link", "/map"])
def test_usual_frames_are_taken(frame: str) -> None:
    assert check_pose(replace(GOOD, frame_id=frame), NOW_NS, STEADY_S, SETTINGS).frame_id == frame


def test_a_stale_pose_is_refused_with_its_age() -> None:
    error = refusal(stamp_sec=NOW_S - 3)
    assert error.code == ErrorCode.STALE_POSE
    assert "3.00 s old" in error.message
    assert "limit is 2 s" in error.message


def test_a_pose_from_the_future_is_refused() -> None:
    error = refusal(stamp_sec=NOW_S + 1)
    assert error.code == ErrorCode.INVALID_STAMP
    assert "1.00 s in the future" in error.message
    near = check_pose(
        replace(GOOD, stamp_sec=NOW_S, stamp_nanosec=400_000_000), NOW_NS, STEADY_S, SETTINGS
    )
    assert near.stamp_ns == NOW_NS + 400_000_000


@pytest.mark.parametrize(("sec", "nanosec"), [(NOW_S, NANOSECONDS), (-1, 0), (0, 2**32 - 1)])
def test_an_impossible_stamp_is_refused(sec: int, nanosec: int) -> None:
    assert refusal(stamp_sec=sec, stamp_nanosec=nanosec).code == ErrorCode.INVALID_STAMP


def test_without_a_stamp_the_age_counts_from_arrival() -> None:
    pose = check_pose(replace(GOOD, stamp_sec=0), NOW_NS, STEADY_S, SETTINGS)
    assert pose.stamp_ns == GOOD.arrival_ns
    error = refusal(stamp_sec=0, arrival_steady_s=STEADY_S - 2.5)
    assert error.code == ErrorCode.STALE_POSE
    assert "2.50 s old" in error.message


def test_with_a_simulated_clock_that_stands_at_zero_arrival_counts() -> None:
    pose = check_pose(GOOD, 0, STEADY_S, SETTINGS)
    assert pose.stamp_ns == (NOW_S - 1) * NANOSECONDS
    with pytest.raises(GraspPlannerError, match="old"):
        check_pose(GOOD, 0, STEADY_S + 10.0, SETTINGS)


def test_covariances() -> None:
    def covariance(C: np.ndarray) -> tuple[float, ...]:
        return tuple(C.ravel().tolist())

    unknown = check_pose(replace(GOOD, covariance=(0.0,) * 36), NOW_NS, STEADY_S, SETTINGS)
    assert unknown.covariance is None
    C = np.diag([1e-6, 2e-6, 3e-6, 1e-4, 0.0, 0.0])
    known = check_pose(replace(GOOD, covariance=covariance(C)), NOW_NS, STEADY_S, SETTINGS)
    assert np.array_equal(known.covariance, C)
    skew = C.copy()
    skew[0, 1] = 1e-6
    for bad, word in ((-C, "-0.0001"), (skew, "symmetric"), (C * np.nan, "finite")):
        error = refusal(covariance=covariance(bad))
        assert error.code == ErrorCode.INVALID_COVARIANCE
        assert word in error.message


def test_defaults_are_filled_in() -> None:
    request = check_request(-1, 0.0, 0, "", "", SETTINGS)
    assert request.seed == SETTINGS.default_seed
    assert request.time_budget_s == SETTINGS.default_time_budget_s
    assert request.n_grasps == SETTINGS.default_n_grasps
    assert request.planner == SETTINGS.default_planner
    assert request.friction is None


@pytest.mark.parametrize("budget", [-1.0, 0.05, 60.5, math.nan, math.inf])
def test_a_time_budget_out_of_range_is_refused(budget: float) -> None:
    with pytest.raises(GraspPlannerError, match=r"\[0\.1, 60\] s") as caught:
        check_request(0, budget, 0, "", "", SETTINGS)
    assert caught.value.code == ErrorCode.TIME_BUDGET_OUT_OF_RANGE
    assert f"{budget:g}" in caught.value.message


@pytest.mark.parametrize("n", [201, 2**32 - 1])
def test_a_number_of_grasps_out_of_range_is_refused(n: int) -> None:
    with pytest.raises(GraspPlannerError, match=f"{n}.*1 to 200") as caught:
        check_request(0, 1.0, n, "", "", SETTINGS)
    assert caught.value.code == ErrorCode.GRASP_COUNT_OUT_OF_RANGE


def test_the_verification_is_the_requests_or_the_parameters() -> None:
    assert check_request(0, 1.0, 1, "", "", SETTINGS).verification == SETTINGS.default_verification
    assert check_request(0, 1.0, 1, "", "require", SETTINGS).verification == "require"
    with pytest.raises(GraspPlannerError, match="'maybe'; choose one of none, rank, require"):
        check_request(0, 1.0, 1, "", "maybe", SETTINGS)


def test_the_objective_is_the_requests_in_printable_letters() -> None:
    plain = check_request(0, 1.0, 1, "", "", SETTINGS)
    assert (plain.objective, plain.task) == ("", "")
    asked = check_request(0, 1.0, 1, "", "", SETTINGS, objective="task", task="turn 0 0 1\n")
    assert (asked.objective, asked.task) == ("task", "turn 0 0 1\\n")


def test_a_request_names_no_module_to_import() -> None:
    with pytest.raises(GraspPlannerError, match=r"objective\.name") as caught:
        check_request(-1, 0.0, 0, "", "", SETTINGS, objective="antigravity:MEASURE")
    assert caught.value.code is ErrorCode.INVALID_SETTING
    assert "'antigravity:MEASURE'" in caught.value.message
    assert "antigravity" not in sys.modules


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(GraspPlannerError, match="-2"):
        check_request(-2, 1.0, 1, "", "", SETTINGS)


def test_an_unknown_planner_is_refused_with_the_known_ones() -> None:
    with pytest.raises(GraspPlannerError) as caught:
        check_request(0, 1.0, 1, "best\n", "", SETTINGS)
    assert caught.value.code == ErrorCode.UNKNOWN_PLANNER
    assert "\n" not in caught.value.message
    for name in PLANNER_NAMES:
        assert name in caught.value.message
