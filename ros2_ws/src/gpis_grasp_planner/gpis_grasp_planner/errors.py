"""One tree of errors; every error has a numeric code, the same one the ROS service answers.

A message says what was wrong, the value found, the limit and the next step. Raise for misuse;
a planner that finds nothing returns a status instead (see ``plan.planner``).
"""

from __future__ import annotations

from enum import IntEnum


class ErrorCode(IntEnum):
    """Codes of answers: 0 success, 1xx request, 2xx mesh, 3xx pose, 4xx planning, 5xx system."""

    SUCCESS = 0

    INVALID_MESH_ID = 100
    UNKNOWN_MESH = 101
    TIME_BUDGET_OUT_OF_RANGE = 102
    GRASP_COUNT_OUT_OF_RANGE = 103
    FRICTION_OUT_OF_RANGE = 104
    UNKNOWN_PLANNER = 105
    INVALID_SETTING = 106
    INVALID_DOCUMENT = 107
    INVALID_SCENE = 108

    MESH_UNREADABLE = 200
    MESH_EMPTY = 201
    MESH_NOT_FINITE = 202
    MESH_EXTENT_IMPLAUSIBLE = 203
    MESH_TOO_LARGE = 204
    MESH_FORMAT_NOT_SUPPORTED = 205
    MESH_BAD_INDEX = 206
    MESH_DEGENERATE = 207
    MESH_SIDECAR_INVALID = 208

    NO_POSE_ESTIMATE = 300
    STALE_POSE = 301
    EMPTY_FRAME = 302
    POSE_NOT_FINITE = 303
    INVALID_QUATERNION = 304
    INVALID_STAMP = 305
    INVALID_COVARIANCE = 306
    NO_TRANSFORM = 307
    TRANSFORM_STALE = 308
    OUTSIDE_WORKSPACE = 309

    NO_FEASIBLE_GRASP = 400
    DEADLINE_EXCEEDED = 401
    CANCELLED = 402
    NO_GRASP_HOLDS = 403
    ALL_GRASPS_BLOCKED = 404
    NOTHING_KNOWN = 405

    BUSY = 500
    PLANNING_PROCESS_LOST = 501
    INTERNAL = 502
    SHUTTING_DOWN = 503
    OUT_OF_MEMORY = 504


class GraspPlannerError(Exception):
    """Base of every error this project raises on purpose.

    Parameters
    ----------
    message : str
        What was wrong, the value, the limit, and what to do next, in one or two sentences.
    code : ErrorCode, optional
        Overrides the class's default code.
    """

    code: ErrorCode = ErrorCode.INTERNAL

    def __init__(self, message: str, code: ErrorCode | None = None):
        super().__init__(message)
        if code is not None:
            self.code = code

    @property
    def message(self) -> str:
        """The text of the error."""
        return str(self)


class RequestError(GraspPlannerError):
    """A request, setting or document that cannot be served as it stands (1xx)."""

    code = ErrorCode.INVALID_SETTING


class MeshError(GraspPlannerError):
    """A mesh file or its sidecar that must not be planned on (2xx)."""

    code = ErrorCode.MESH_UNREADABLE


class PoseError(GraspPlannerError):
    """An object pose that must not be used (3xx)."""

    code = ErrorCode.POSE_NOT_FINITE


class PlanningError(GraspPlannerError):
    """Planning that ended without an answer (4xx)."""

    code = ErrorCode.NO_FEASIBLE_GRASP


class SystemFault(GraspPlannerError):
    """A fault of the process, the machine or the project itself (5xx)."""

    code = ErrorCode.INTERNAL
