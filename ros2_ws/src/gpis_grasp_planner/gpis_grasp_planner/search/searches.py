"""The searches by name: those of this package, and those that other distributions register.

Another distribution (such as the benchmark of this repository) registers a search by an entry point
of the group ``gpis_grasp_planner.planners``: a name, and a callable that makes a `Search` of a
`PlanningContext`. Entry points are looked at only where a name is not one of ours.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import EntryPoint

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.registered import registered as registered_in
from gpis_grasp_planner.search.context import PlanningContext, Search
from gpis_grasp_planner.search.dual import DualOptimiser
from gpis_grasp_planner.search.hpp_opt import PalmPoseOptimiser
from gpis_grasp_planner.search.paper_dual import PaperDualOptimiser
from gpis_grasp_planner.search.random_search import RandomPalms, RandomWithAdaption

GROUP = "gpis_grasp_planner.planners"
PLANNERS: dict[str, Callable[[PlanningContext], Search]] = {
    "dual": DualOptimiser,
    "hpp": PalmPoseOptimiser,
    "paper": PaperDualOptimiser,
    "random": RandomPalms,
    "random-adaption": RandomWithAdaption,
}


def make_search(name: str, context: PlanningContext) -> Search:
    """The search `name`, ready to step.

    Raises
    ------
    RequestError
        UNKNOWN_PLANNER, naming the known ones.
    """
    check_planner(name)
    make = PLANNERS.get(name)
    if make is None:
        make = registered()[name].load()
    search: Search = make(context)
    return search


def registered() -> dict[str, EntryPoint]:
    """What other distributions of this environment register, by name; a name of ours stays ours."""
    return registered_in(GROUP, PLANNERS)


def planner_names() -> tuple[str, ...]:
    """All names: this package's, then those of other distributions. Some 10 ms."""
    return (*PLANNERS, *registered())


def check_planner(name: str) -> str:
    """Return the name, or raise RequestError that lists the known planners."""
    if name not in PLANNERS and name not in (known := planner_names()):
        raise RequestError(
            f"Unknown planner '{name}'; choose one of {', '.join(known)}.",
            ErrorCode.UNKNOWN_PLANNER,
        )
    return name
