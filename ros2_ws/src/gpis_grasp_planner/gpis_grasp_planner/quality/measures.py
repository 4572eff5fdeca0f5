"""The measures by name: those of this package, and those that other distributions register.

Another distribution registers a measure by an entry point of the group
``gpis_grasp_planner.measures``: a name, and a `Measure` whose figure has that name. Entry points
are looked at only where a name is not one of ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib.metadata import EntryPoint, entry_points

import numpy as np

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.quality.figures import Figure
from gpis_grasp_planner.quality.least_friction import LEAST_FRICTION
from gpis_grasp_planner.quality.measure import HeldPart, Measure
from gpis_grasp_planner.quality.min_weight import MIN_WEIGHT
from gpis_grasp_planner.quality.settings import ObjectiveSettings
from gpis_grasp_planner.quality.task import task_measure

GROUP = "gpis_grasp_planner.measures"
MEASURES: dict[str, Callable[[ObjectiveSettings], Measure]] = {
    "min_weight": lambda _: MIN_WEIGHT,
    "least_friction": lambda _: LEAST_FRICTION,
    "task": lambda settings: task_measure(settings.task),
}


def registered() -> dict[str, EntryPoint]:
    """What other distributions of this environment register, by name; a name of ours stays ours."""
    found = sorted(entry_points(group=GROUP), key=lambda point: point.name)
    return {point.name: point for point in found if point.name not in MEASURES}


def make_measure(name: str, settings: ObjectiveSettings) -> Measure:
    """The measure of a name.

    Raises
    ------
    RequestError
        INVALID_SETTING: no such measure, with the known ones; or what is registered is none.
    """
    if name in MEASURES:
        return MEASURES[name](settings)
    others = registered()
    if name not in others:
        raise RequestError(
            f"There is no measure '{name}'; known are {', '.join([*MEASURES, *others])}. "
            f"Another one is registered by an entry point of the group {GROUP}."
        )
    point = others[name]
    try:
        measure = point.load()
    except Exception as error:  # what a stranger's module raises is not known
        raise RequestError(
            f"The measure '{name}' ({point.value}) cannot be imported: {error!r}. Repair or "
            "remove its distribution."
        ) from error
    if not isinstance(measure, Measure) or measure.figure.name != name:
        raise RequestError(
            f"The entry point '{name}' ({point.value}) is {measure!r}; it must be a Measure whose "
            f"figure is named '{name}'."
        )
    return measure


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
