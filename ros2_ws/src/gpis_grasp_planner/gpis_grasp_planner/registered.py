"""What users and other distributions add to the planner: found by name, loaded, or refused.

A distribution registers an object by an entry point, a name in a group. A module that is not
installed, but can be imported, is named with its object: ``module:NAME``.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from importlib.metadata import EntryPoint, entry_points

from gpis_grasp_planner.errors import RequestError


def registered(group: str, ours: Collection[str] = ()) -> dict[str, EntryPoint]:
    """What other distributions of this environment register, by name; a name of ours stays ours."""
    found = sorted(entry_points(group=group), key=lambda point: point.name)
    return {point.name: point for point in found if point.name not in ours}


def names_a_module(name: str) -> bool:
    """Whether a name is ``module:NAME``, so that looking it up imports what it names."""
    return ":" in name


def find(kind: str, group: str, name: str, ours: Collection[str] = ()) -> EntryPoint:
    """The entry point of a name, or of ``module:NAME``.

    Parameters
    ----------
    kind : str
        What it is, for messages, such as "measure".
    group : str
        Of entry points.
    name : str
    ours : collection of str
        The planner's own names, which nobody replaces.

    Raises
    ------
    RequestError
        INVALID_SETTING: no such name, with the known ones.
    """
    if names_a_module(name):
        return EntryPoint(name, name, group)
    others = registered(group, ours)
    if name not in others:
        raise RequestError(
            f"There is no {kind} '{name}'; known are {_listed([*ours, *others])}. Another one is "
            f"registered by an entry point of the group {group}, or named as module:NAME."
        )
    return others[name]


def load(kind: str, point: EntryPoint) -> object:
    """The object of an entry point.

    Raises
    ------
    RequestError
        INVALID_SETTING: its module cannot be imported, or has no such object.
    """
    try:
        return point.load()
    except Exception as error:  # what a stranger's module raises is not known
        raise RequestError(
            f"The {kind} '{point.name}' ({point.value}) cannot be imported: {error!r}. Repair or "
            "remove its distribution; a module's folder has to be in PYTHONPATH."
        ) from error


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"
