"""The measures by name: those of this package, and those that other distributions register.

Another distribution registers a measure by an entry point of the group
``gpis_grasp_planner.measures``: a name, and a `Measure` whose figure has that name. Entry points
are looked at only where a name is not one of ours. ``module:NAME`` names one that nobody
registered.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.quality.figures import ALWAYS, Figure
from gpis_grasp_planner.quality.least_friction import LEAST_FRICTION
from gpis_grasp_planner.quality.measure import HeldPart, Measure
from gpis_grasp_planner.quality.min_weight import MIN_WEIGHT
from gpis_grasp_planner.quality.settings import ObjectiveSettings
from gpis_grasp_planner.quality.task import task_measure
from gpis_grasp_planner.registered import find, load, names_a_module

GROUP = "gpis_grasp_planner.measures"
MEASURES: dict[str, Callable[[ObjectiveSettings], Measure]] = {
    "min_weight": lambda _: MIN_WEIGHT,
    "least_friction": lambda _: LEAST_FRICTION,
    "task": lambda settings: task_measure(settings.task),
}


def make_measure(
    name: str, settings: ObjectiveSettings, kind: str = "measure", others: tuple[str, ...] = ()
) -> Measure:
    """The measure of a name.

    Parameters
    ----------
    name : str
    settings : ObjectiveSettings
    kind : str
        What it is looked for as, for messages.
    others : tuple of str
        What else may be named there.

    Raises
    ------
    RequestError
        INVALID_SETTING: no such measure, with the known ones; or what is registered is none.
    """
    if name in MEASURES:
        return MEASURES[name](settings)
    point = find(kind, GROUP, name, (*others, *MEASURES))
    measure = load(kind, point)
    wanted = "with a name of its own" if names_a_module(name) else f"named '{name}'"
    if not isinstance(measure, Measure) or not _may_be_named(measure.figure.name, name):
        raise RequestError(
            f"'{name}' ({point.value}) is {measure!r}; it must be a Measure whose figure is "
            f"{wanted}."
        )
    return measure


def _may_be_named(figure: str, name: str) -> bool:
    ours = {*MEASURES, *(always.name for always in ALWAYS)}
    return figure not in ours if names_a_module(name) else figure == name


def measured(held: HeldPart, measures: Iterable[Measure]) -> dict[str, float]:
    """Figures by name; one that is not finite is left out."""
    found = {}
    for measure in measures:
        value = value_of(measure, held)
        if np.isfinite(value):
            found[measure.figure.name] = value
    return found


def value_of(measure: Measure, held: HeldPart) -> float:
    """A measure's figure.

    Raises
    ------
    RequestError
        If its function raises: naming the measure.
    """
    try:
        return float(measure.of(held))
    except Exception as error:  # of a stranger's function
        raise RequestError(
            f"The measure '{measure.figure.name}' raised {error!r} for a grasp of "
            f"{len(held.contacts)} contacts. Repair it, or choose another objective."
        ) from error


def figures_of(measures: Iterable[Measure]) -> tuple[Figure, ...]:
    """What their numbers mean."""
    return tuple(measure.figure for measure in measures)
