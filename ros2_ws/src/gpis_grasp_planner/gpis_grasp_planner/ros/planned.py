"""What goes between the node and its planning process: plain data, cheap to import and pickle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.planning.grasp import Grasp
from gpis_grasp_planner.planning.request import PlanRequest


@dataclass(frozen=True)
class PlanOrder:
    """One plan to make.

    `settings` holds, per group, the values by name: those of ``planning.settings`` and the
    group "catalogue".
    """

    mesh_id: str
    mesh_directories: tuple[str, ...]
    request: PlanRequest
    settings: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class Plan:
    """Grasps of one mesh in its own frame, best first, or the reason why there are none.

    Attributes
    ----------
    code : ErrorCode
        SUCCESS, or why `grasps` is empty.
    message : str
    mesh_id, mesh_hash : str
        The hash is that of the geometry that was planned on (SHA-256, hex).
    grasps : tuple of Grasp
    best_attempt : Grasp or None
        Without a feasible grasp: the nearest miss. Not to be executed.
    notes : tuple of str
        What was repaired or assumed about the mesh.
    evaluations : int
        Grasps tried.
    elapsed_s : float
        Time in the planning process.
    """

    code: ErrorCode
    message: str
    mesh_id: str
    mesh_hash: str
    grasps: tuple[Grasp, ...]
    best_attempt: Grasp | None
    notes: tuple[str, ...]
    evaluations: int
    elapsed_s: float


@dataclass(frozen=True)
class WorkerReady:
    """The planning process has imported everything and takes orders."""


@dataclass(frozen=True)
class WorkerAccepted:
    """The planning process has begun with an order."""


@dataclass(frozen=True)
class WorkerProgress:
    """How far the running plan is."""

    elapsed_s: float
    evaluations: int
    best_epsilon: float
    n_grasps: int


@dataclass(frozen=True)
class WorkerError:
    """The running plan ended with an error of the project's tree, or an unexpected one."""

    code: ErrorCode
    message: str
