"""What goes between the node and its planning process: plain data, cheap to import and pickle.

Every message is a pair of a number and one of these; answers have the number of their order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.plan.request import PlanRequest


@dataclass(frozen=True)
class PlanOrder:
    """One plan to make.

    `settings` holds, per group, the values by name: those of ``plan.settings`` and the
    group "catalogue". With a `place` (`surroundings.place.Place.as_mapping`) the search knows the
    surroundings, and the plan is for this place alone; `blocked` says what had blocked the plan
    in free space. The plan of an order with a `present` place is good for all places: only the
    trials in physics follow it.
    """

    mesh_id: str
    mesh_directories: tuple[str, ...]
    request: PlanRequest
    settings: Mapping[str, Mapping[str, Any]]
    place: Mapping[str, Any] | None = None
    blocked: str = ""
    present: Mapping[str, Any] | None = None


@dataclass(frozen=True, eq=False)
class PlaceOrder:
    """One plan to be answered for a place of its part, while another may be made.

    Attributes
    ----------
    plan : Plan
        With its record.
    mesh_directories : tuple of str
    place : mapping
        `surroundings.place.Place.as_mapping`.
    n_grasps : int
    time_budget_s : float
        Nothing further is begun after this time; one grasp is always looked at.
    settings : mapping
        As in PlanOrder.
    """

    plan: Plan
    mesh_directories: tuple[str, ...]
    place: Mapping[str, Any]
    n_grasps: int
    time_budget_s: float
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
    record : bytes
        The whole result with its reserve, for the planning process alone: it travels with every
        order to place the plan, so that a new process needs nothing of an old one's.
    blocked : str
        What was blocked at the place that the plan is for, by cause.
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
    record: bytes = b""
    blocked: str = ""


@dataclass(frozen=True)
class WorkerReady:
    """The planning process has imported everything and takes orders."""


@dataclass(frozen=True)
class WorkerAccepted:
    """The planning process has begun to plan, or has taken an order to place a plan."""


@dataclass(frozen=True)
class WorkerProgress:
    """How far the running plan is."""

    elapsed_s: float
    evaluations: int
    best_epsilon: float
    n_grasps: int


@dataclass(frozen=True)
class WorkerError:
    """An order ended with an error of the project's tree, or an unexpected one."""

    code: ErrorCode
    message: str
