"""What came of one part of a catalogue."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.plan.request import PlanResult


@dataclass(frozen=True)
class Outcome:
    """What came of one part.

    Attributes
    ----------
    mesh_id : str
    code : str
        Name of the `ErrorCode`.
    message : str
    n_grasps, n_tried, n_held : int
    best_epsilon : float or None
        The largest of the grasps.
    from_store : bool
        It was kept before; nothing was planned.
    kept : bool
        It is in the store now.
    elapsed_s : float
        Of this run.
    mesh_hash : str
        Empty where the mesh could not be read.
    picture : str
        Name of the picture's file; empty where none was drawn.
    """

    mesh_id: str
    code: str
    message: str
    n_grasps: int = 0
    n_tried: int = 0
    n_held: int = 0
    best_epsilon: float | None = None
    from_store: bool = False
    kept: bool = False
    elapsed_s: float = 0.0
    mesh_hash: str = ""
    picture: str = ""

    @property
    def found(self) -> bool:
        """Whether there are grasps."""
        return self.n_grasps > 0

    @property
    def planned(self) -> bool:
        """Whether a search was made in this run."""
        return bool(self.mesh_hash) and not self.from_store

    def as_mapping(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""
        return asdict(self)

    @staticmethod
    def of(result: PlanResult, *, from_store: bool, kept: bool, elapsed_s: float) -> Outcome:
        """That of a part which has an answer."""
        tried = [grasp.trials for grasp in result.grasps if grasp.trials is not None]
        return Outcome(
            result.mesh_id,
            result.code.name,
            result.message,
            n_grasps=len(result.grasps),
            n_tried=len(tried),
            n_held=sum(trials.held for trials in tried),
            best_epsilon=max((grasp.epsilon for grasp in result.grasps), default=None),
            from_store=from_store,
            kept=kept,
            elapsed_s=elapsed_s,
            mesh_hash=result.mesh_hash,
        )

    @staticmethod
    def failed(mesh_id: str, error: GraspPlannerError, elapsed_s: float) -> Outcome:
        """That of a part which could not be read or planned."""
        return Outcome(mesh_id, error.code.name, error.message, elapsed_s=elapsed_s)

    @staticmethod
    def lost(mesh_id: str, why: str, elapsed_s: float) -> Outcome:
        """That of a part whose process ended before it answered."""
        code = ErrorCode.PLANNING_PROCESS_LOST.name
        return Outcome(mesh_id, code, why, elapsed_s=elapsed_s)
