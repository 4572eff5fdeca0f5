"""What goes between the node and its planning process: plain data, cheap to import and pickle.

Every message is a pair of a number and one of these; answers have the number of their order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from gpis_grasp_planner.errors import ErrorCode
from gpis_grasp_planner.grasp.funnel import Funnel
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.plan.progress import Progress
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.quality.figures import ALWAYS, Figure


@dataclass(frozen=True)
class PlanOrder:
    """One plan to make.

    `settings` holds, per group, the values by name: those of ``plan.settings`` and the
    group "catalogue". `place` is a `surroundings.place.Place.as_mapping`, None for free space;
    `known` the record of an earlier plan of the mesh, whose grasps compete. `read_limit_s` [s] is
    how long reading a mesh may take.
    """

    mesh_id: str
    mesh_directories: tuple[str, ...]
    request: PlanRequest
    settings: Mapping[str, Mapping[str, Any]]
    place: Mapping[str, Any] | None = None
    known: bytes = b""
    read_limit_s: float = 60.0


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
    request : PlanRequest
        After its time budget nothing further is begun; one grasp is always looked at.
    settings : mapping
    read_limit_s : float
        As in PlanOrder.
    """

    plan: Plan
    mesh_directories: tuple[str, ...]
    place: Mapping[str, Any]
    request: PlanRequest
    settings: Mapping[str, Mapping[str, Any]]
    read_limit_s: float = 60.0


@dataclass(frozen=True)
class DescribeOrder:
    """Say what a mesh is; fields as in PlanOrder."""

    mesh_id: str
    mesh_directories: tuple[str, ...]
    request: PlanRequest
    settings: Mapping[str, Mapping[str, Any]]
    read_limit_s: float = 60.0


@dataclass(frozen=True)
class MeshFacts:
    """What a mesh is: size of its bounding box [m], mass [kg]."""

    size: tuple[float, float, float]
    mass: float


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
    place : mapping or None
        The place that the plan is for; None for free space.
    funnel : Funnel
        Where grasps got lost.
    objective : str
        By which the grasps were ranked, as a formula.
    figures : tuple of Figure
        What the figures of the grasps' qualities mean.
    enough : bool
        Whether a plan from what was known needs no further search
        (`plan.placing.KnownAnswer.satisfies`).
    from_store : bool
        Whether it is an earlier plan out of the grasp store: nothing was searched.
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
    place: Mapping[str, Any] | None = None
    enough: bool = True
    from_store: bool = False
    funnel: Funnel = field(default_factory=Funnel)
    objective: str = ""
    figures: tuple[Figure, ...] = ALWAYS


@dataclass(frozen=True)
class CancelOrder:
    """Goes to the planning process: the order of this number is not wanted any more."""


@dataclass(frozen=True)
class WorkerAlive:
    """The planning process has not been stopped; sent every second, as order 0."""


@dataclass(frozen=True)
class WorkerReady:
    """The planning process has imported everything and takes orders."""


@dataclass(frozen=True)
class WorkerAccepted:
    """The planning process has begun to work on an order."""


@dataclass(frozen=True)
class WorkerProgress:
    """How far the running plan is."""

    progress: Progress


@dataclass(frozen=True)
class WorkerError:
    """An order ended with an error of the project's tree, or an unexpected one."""

    code: ErrorCode
    message: str
