"""The searches by name."""

from __future__ import annotations

from collections.abc import Callable

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.search.context import PlanningContext, Search
from gpis_grasp_planner.search.dual import DualOptimiser
from gpis_grasp_planner.search.hpp_opt import PalmPoseOptimiser
from gpis_grasp_planner.search.paper_dual import PaperDualOptimiser
from gpis_grasp_planner.search.random_search import RandomPalms, RandomWithAdaption
from gpis_grasp_planner.search.rivals.auto_grasp import AutoGraspAnnealing
from gpis_grasp_planner.search.rivals.eigengrasp import EigenGraspAnnealing
from gpis_grasp_planner.search.rivals.two_level import TwoLevelAnnealing

PLANNERS: dict[str, Callable[[PlanningContext], Search]] = {
    "dual": DualOptimiser,
    "hpp": PalmPoseOptimiser,
    "paper": PaperDualOptimiser,
    "random": RandomPalms,
    "random-adaption": RandomWithAdaption,
    "annealing": AutoGraspAnnealing,
    "eigengrasp": EigenGraspAnnealing,
    "eigengrasp-two-level": TwoLevelAnnealing,
}


def make_search(name: str, context: PlanningContext) -> Search:
    """The search `name`, ready to step.

    Raises
    ------
    RequestError
        UNKNOWN_PLANNER, naming the known ones.
    """
    check_planner(name)
    return PLANNERS[name](context)


def check_planner(name: str) -> str:
    """Return the name, or raise RequestError that lists the known planners."""
    if name not in PLANNERS:
        raise RequestError(
            f"Unknown planner '{name}'; choose one of {', '.join(PLANNERS)}.",
            ErrorCode.UNKNOWN_PLANNER,
        )
    return name
