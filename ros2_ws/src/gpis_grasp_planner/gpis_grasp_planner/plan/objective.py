"""The objective and the reported figures that settings ask for."""

from __future__ import annotations

from dataclasses import replace

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.measure import Measure
from gpis_grasp_planner.quality.measures import make_measure
from gpis_grasp_planner.quality.objective import EpsilonVolume, Objective, OneMeasure
from gpis_grasp_planner.quality.settings import ObjectiveSettings
from gpis_grasp_planner.quality.surface_knowledge import KnownContacts, contact_deviation
from gpis_grasp_planner.search.settings import HppSettings
from gpis_grasp_planner.surroundings.uncertainty_settings import UncertaintySettings

PAPER = "paper"
TASK = "task"


def settings_for(request: PlanRequest, settings: PlannerSettings) -> PlannerSettings:
    """The settings with the objective that a request asks for; themselves where it asks none."""
    if not (request.objective or request.task):
        return settings
    own = settings.objective
    name = request.objective or TASK
    asked = replace(own, name=name, task=request.task or own.task)
    return replace(settings, objective=asked)


def make_objective(settings: PlannerSettings, part: Part | None = None) -> Objective:
    """What a search by these settings maximises for a part.

    Raises
    ------
    RequestError
        INVALID_SETTING: an unknown measure, a task that cannot be read, or one of them with the
        search in PyBullet, which knows the paper's objective alone.
    """
    objective = _objective(settings.objective, settings.hpp)
    if objective.measures and settings.scene.search_evaluator == "bullet":
        raise RequestError(
            "The search in PyBullet (scene.search_evaluator is 'bullet') knows the objective "
            f"'{PAPER}' alone, not '{settings.objective.name}'; set it to 'compiled'."
        )
    return _known_contacts(objective, part, settings.uncertainty)


def reported_measures(settings: PlannerSettings, part: Part | None = None) -> tuple[Measure, ...]:
    """The measures whose figures an answer's grasps have: the objective's own, then the reported.

    Raises
    ------
    RequestError
        INVALID_SETTING, as :func:`make_objective`.
    """
    return (*_reported(settings.objective), *_of_surface(part))


def objective_of(result: PlanResult, part: Part | None = None) -> Objective:
    """The objective that a result's grasps of a part were ranked by.

    Raises
    ------
    RequestError
        INVALID_SETTING: its settings are not those of this program, or its measure is not here.
    """
    hpp = HppSettings(volume_weight=result.settings["hpp"]["volume_weight"])
    uncertainty = UncertaintySettings.from_mapping(result.settings.get("uncertainty", {}))
    return _known_contacts(_objective(_settings_of(result), hpp), part, uncertainty)


def measures_of(result: PlanResult, part: Part | None = None) -> tuple[Measure, ...]:
    """The measures whose figures a result's grasps have; none where an earlier program made it."""
    own = _reported(_settings_of(result)) if "objective" in result.settings else ()
    return (*own, *_of_surface(part))


def _settings_of(result: PlanResult) -> ObjectiveSettings:
    return ObjectiveSettings.from_mapping(result.settings.get("objective", {}))


def _objective(settings: ObjectiveSettings, hpp: HppSettings) -> Objective:
    if settings.name == PAPER:
        return EpsilonVolume(hpp.volume_weight)
    return OneMeasure(make_measure(settings.name, settings, "objective", (PAPER,)))


def _of_surface(part: Part | None) -> tuple[Measure, ...]:
    """What is measured of the grasps of a part that was scanned."""
    if part is None or part.uncertainty is None:
        return ()
    return (contact_deviation(part.uncertainty.deviation_at),)


def _known_contacts(
    objective: Objective, part: Part | None, settings: UncertaintySettings
) -> Objective:
    if part is None or part.uncertainty is None:
        return objective
    [measure] = _of_surface(part)
    return KnownContacts(objective, measure, settings.contact_deviation_m)


def _reported(settings: ObjectiveSettings) -> tuple[Measure, ...]:
    named = _objective(settings, HppSettings()).measures
    reported = [name for name in settings.report if name != settings.name]
    return (*named, *(make_measure(name, settings) for name in reported))
