"""What a request and a pose may be: pure checks, free of ROS, each with its code.

Rules for poses (``docs/node.md`` states them for users): finite; position within 1000 km; norm of
the quaternion within 1e-3 of 1, then normalised; a frame; a stamp that is zero (age counts from
arrival) or neither too old nor in the future; covariance finite, symmetric, not negative.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, PoseError, RequestError
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.plan.request import TIME_BUDGET_RANGE_S, PlanRequest
from gpis_grasp_planner.registered import names_a_module
from gpis_grasp_planner.ros.settings import PLANNER_NAMES, NodeSettings
from gpis_grasp_planner.ros.text import FRAME_PATTERN, printable
from gpis_grasp_planner.surroundings.covariance import check_covariance

Array = NDArray[np.float64]

QUATERNION_TOLERANCE = 1e-3
POSITION_LIMIT_M = 1e6
NANOSECONDS = 1_000_000_000


@dataclass(frozen=True, eq=False)
class RawPose:
    """An object pose as it arrived, unchecked.

    `arrival_ns` is the ROS time of arrival, `arrival_steady_s` that of the steady clock.
    """

    source: str
    frame_id: str
    stamp_sec: int
    stamp_nanosec: int
    position: tuple[float, float, float]
    quat_xyzw: tuple[float, float, float, float]
    covariance: tuple[float, ...] | None
    arrival_ns: int
    arrival_steady_s: float

    @property
    def stamped_ns(self) -> int:
        """Its stamp [ns], unchecked; the time of arrival where that is zero."""
        return self.stamp_sec * NANOSECONDS + self.stamp_nanosec or self.arrival_ns


@dataclass(frozen=True, eq=False)
class ObjectPose:
    """A checked pose of the object's frame in frame `frame_id`.

    `stamp_ns` is the message's stamp, or the time of arrival where that was zero; `covariance`
    is (6, 6) in the order x, y, z [m], rotation about x, y, z [rad], None where unknown.
    """

    T_world_object: Array
    frame_id: str
    stamp_ns: int
    covariance: Array | None
    notes: tuple[str, ...]

    def same_as(self, other: ObjectPose) -> bool:
        """Whether both are of one estimate: nothing has come since."""
        if (self.frame_id, self.stamp_ns) != (other.frame_id, other.stamp_ns):
            return False
        if self.covariance is None or other.covariance is None:
            same = self.covariance is other.covariance
        else:
            same = np.array_equal(self.covariance, other.covariance)
        return same and np.array_equal(self.T_world_object, other.T_world_object)


def check_request(
    seed: int,
    time_budget: float,
    n_grasps: int,
    planner: str,
    verification: str,
    settings: NodeSettings,
    *,
    objective: str = "",
    task: str = "",
) -> PlanRequest:
    """Fill in the defaults (seed -1, budget 0, number 0, empty texts) and check the bounds.

    Raises
    ------
    RequestError
        TIME_BUDGET_OUT_OF_RANGE, GRASP_COUNT_OUT_OF_RANGE, UNKNOWN_PLANNER or INVALID_SETTING.
    """
    low, high = TIME_BUDGET_RANGE_S[0], settings.max_time_budget_s
    budget = settings.default_time_budget_s if time_budget == 0.0 else time_budget
    # Written so that NaN is refused, too.
    if not low <= budget <= high:
        raise RequestError(
            f"The time budget is {budget:g} s; it must be in [{low:g}, {high:g}] s (the upper "
            "bound is the parameter max_time_budget_s). Give 0 for the default of "
            f"{settings.default_time_budget_s:g} s.",
            ErrorCode.TIME_BUDGET_OUT_OF_RANGE,
        )
    if planner and planner not in PLANNER_NAMES:
        raise RequestError(
            f"The planner '{printable(planner, 40)}' is unknown; choose one of "
            f"{', '.join(PLANNER_NAMES)}, or leave it empty for {settings.default_planner}.",
            ErrorCode.UNKNOWN_PLANNER,
        )
    if names_a_module(objective):
        raise RequestError(
            f"The objective is '{printable(objective, 64)}'; a request may name a measure that is "
            "known or installed. A module of your own is imported where the node is started: give "
            "it as the parameter objective.name."
        )
    return PlanRequest(
        planner=planner or settings.default_planner,
        seed=settings.default_seed if seed == -1 else seed,
        time_budget_s=float(budget),
        n_grasps=n_grasps or settings.default_n_grasps,
        friction=settings.friction,
        verification=printable(verification, 40) or settings.default_verification,
        objective=printable(objective, 64),
        task=printable(task, 400),
    )


def check_pose(
    raw: RawPose, now_ns: int, now_steady_s: float, settings: NodeSettings
) -> ObjectPose:
    """Check a pose at the time it is to be used.

    Parameters
    ----------
    raw : RawPose
    now_ns : int
        ROS time [ns]; 0 while a simulated clock has not started, and then ages are those of
        arrival on the steady clock.
    now_steady_s : float
    settings : NodeSettings

    Raises
    ------
    PoseError
        With the code of the first rule that is broken.
    """
    check_frame(raw)
    T_world_object, note = _checked_transform(raw)
    _check_workspace(raw, settings.workspace_radius_m)
    covariance = _known_covariance(raw)
    stamp_ns = _checked_stamp(raw, now_ns, now_steady_s, settings)
    return ObjectPose(T_world_object, raw.frame_id, stamp_ns, covariance, note)


def check_frame(raw: RawPose) -> None:
    """Refuse a pose without a usable frame name. Whether the frame exists is not looked up."""
    if FRAME_PATTERN.fullmatch(raw.frame_id) is None:
        what = f"'{printable(raw.frame_id, 40)}'" if raw.frame_id else "empty"
        raise PoseError(
            f"The frame_id of {raw.source} is {what}; it must be 1 to 255 letters, digits or "
            "'_./~:-'. Set header.frame_id to the frame the pose is expressed in.",
            ErrorCode.EMPTY_FRAME,
        )


def _checked_transform(raw: RawPose) -> tuple[Array, tuple[str, ...]]:
    values = np.array([*raw.position, *raw.quat_xyzw], dtype=float)
    if not np.isfinite(values).all():
        raise PoseError(
            f"The pose of {raw.source} is not finite: position {list(raw.position)}, orientation "
            f"{list(raw.quat_xyzw)}. Every number must be finite; check the pose estimator.",
            ErrorCode.POSE_NOT_FINITE,
        )
    if np.abs(values[:3]).max() > POSITION_LIMIT_M:
        raise PoseError(
            f"The position of {raw.source} is {list(raw.position)} m; the limit is "
            f"{POSITION_LIMIT_M:g} m. Check the pose estimator's units.",
            ErrorCode.POSE_NOT_FINITE,
        )
    norm = float(np.linalg.norm(values[3:]))
    if abs(norm - 1.0) > QUATERNION_TOLERANCE:
        raise PoseError(
            f"The quaternion of {raw.source} has the norm {norm:.6g}; it must be 1 within "
            f"{QUATERNION_TOLERANCE:g}. Normalise it (order x, y, z, w; no rotation is 0 0 0 1).",
            ErrorCode.INVALID_QUATERNION,
        )
    notes: tuple[str, ...] = ()
    if abs(norm - 1.0) > 1e-6:
        notes = (f"The quaternion of {raw.source} had the norm {norm:.6g} and was normalised.",)
    return from_position_quat_xyzw(values[:3], values[3:] / norm), notes


def _check_workspace(raw: RawPose, radius_m: float) -> None:
    distance = float(np.linalg.norm(raw.position))
    if distance > radius_m:
        hint = f" In millimetres that would be {distance / 1e3:.3g} m." if distance < 1e5 else ""
        raise PoseError(
            f"The position of {raw.source} is {distance:g} m from the origin of "
            f"'{printable(raw.frame_id, 60)}'; the limit is {radius_m:g} m (parameter "
            f"workspace_radius_m).{hint} Give metres, or raise the limit.",
            ErrorCode.OUTSIDE_WORKSPACE,
        )


def _known_covariance(raw: RawPose) -> Array | None:
    """Covariance (6, 6), or None where it is all zero, which says that it is not known."""
    if raw.covariance is None:
        return None
    C = check_covariance(np.array(raw.covariance, dtype=float).reshape(6, 6), raw.source)
    return C if C.any() else None


def _checked_stamp(raw: RawPose, now_ns: int, now_steady_s: float, settings: NodeSettings) -> int:
    if not (0 <= raw.stamp_nanosec < NANOSECONDS and raw.stamp_sec >= 0):
        raise PoseError(
            f"The stamp of {raw.source} is {raw.stamp_sec} s + {raw.stamp_nanosec} ns; seconds "
            "must not be negative and nanoseconds below 1e9. Check the pose estimator's clock.",
            ErrorCode.INVALID_STAMP,
        )
    stamp_ns = raw.stamp_sec * NANOSECONDS + raw.stamp_nanosec
    if stamp_ns == 0:
        stamp_ns = raw.arrival_ns
        age_s = now_steady_s - raw.arrival_steady_s
    elif now_ns == 0:
        age_s = now_steady_s - raw.arrival_steady_s
    else:
        age_s = (now_ns - stamp_ns) / NANOSECONDS
    if age_s > settings.max_pose_age_s:
        raise PoseError(
            f"The pose of {raw.source} is {age_s:.2f} s old; the limit is "
            f"{settings.max_pose_age_s:g} s (parameter max_pose_age_s). Publish a new estimate, "
            "and compare the clocks of the two machines.",
            ErrorCode.STALE_POSE,
        )
    if age_s < -settings.max_pose_ahead_s:
        raise PoseError(
            f"The stamp of {raw.source} lies {-age_s:.2f} s in the future; the limit is "
            f"{settings.max_pose_ahead_s:g} s (parameter max_pose_ahead_s). Compare the clocks "
            "of the two machines (use_sim_time included).",
            ErrorCode.INVALID_STAMP,
        )
    return stamp_ns
