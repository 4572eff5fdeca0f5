"""Options that restrict grasps: where the hand may come from, and what it must not touch."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gpis_grasp_planner.cli import completion

if TYPE_CHECKING:
    from gpis_grasp_planner.surroundings.approach_cone import ApproachCone
    from gpis_grasp_planner.surroundings.forbidden_region import ForbiddenRegion

FIELDS = ("approach", "forbidden")


def add_constraints(parser: argparse.ArgumentParser) -> None:
    """Add --approach and --forbid."""
    group = parser.add_argument_group("what grasps must respect")
    group.add_argument(
        "--approach",
        metavar="X,Y,Z,DEG",
        help="the hand comes along this direction of the scene's frame, at most DEG degrees "
        "beside it: 0,0,-1,30 is from above",
    )
    group.add_argument(
        "--forbid",
        metavar="X,Y,Z,DX,DY,DZ",
        action="append",
        default=[],
        help="a box of the part that the hand must not touch: its middle and its edges [m], along "
        "the axes of the part's own frame; repeatable",
    )


def add_own(parser: argparse.ArgumentParser) -> None:
    """Add --constraint."""
    own = parser.add_argument(
        "--constraint",
        metavar="NAME",
        action="append",
        default=[],
        dest="constraint_names",
        help="a constraint of your own: the name of an installed distribution's, or module:NAME; "
        "repeatable; in place of the setting constraints.names (docs/extending.md)",
    )
    own.completer = completion.constraint_names  # type: ignore[attr-defined]


def with_own(assignments: Sequence[str], names: Sequence[str]) -> list[str]:
    """Assignments of settings with the constraints of --constraint."""
    return [*assignments, *([f"constraints.names={','.join(names)}"] if names else [])]


def constraints_of(
    arguments: argparse.Namespace, scene: Mapping[str, Any]
) -> tuple[ApproachCone | None, tuple[ForbiddenRegion, ...]]:
    """Read the options, and the fields "approach" and "forbidden" of a scene.

    Raises
    ------
    RequestError
        INVALID_SCENE.
    """
    from gpis_grasp_planner.surroundings.approach_cone import ApproachCone
    from gpis_grasp_planner.surroundings.forbidden_region import read_regions

    cone = None
    if scene.get("approach") is not None:
        cone = ApproachCone.from_mapping(scene["approach"])
    if arguments.approach is not None:
        if cone is not None:
            raise _wrong("Both --approach and the scene's file give an approach. Leave one out.")
        import numpy as np

        *axis, angle = _numbers("--approach", arguments.approach, 4)
        cone = ApproachCone(np.array(axis), angle)
    entries = list(arguments.forbid)
    boxes = [_numbers("--forbid", text, 6) for text in entries]
    given = [
        {"position": box[:3], "size": box[3:], "name": f"forbidden {text}"}
        for box, text in zip(boxes, entries, strict=True)
    ]
    return cone, (*read_regions(scene.get("forbidden", [])), *read_regions(given))


def _numbers(option: str, text: str, n: int) -> list[float]:
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != n:
        raise _wrong(f"{option} is '{text}'; give {n} numbers separated by commas.")
    return numbers


def _wrong(message: str) -> Exception:
    from gpis_grasp_planner.errors import ErrorCode, RequestError

    return RequestError(message, ErrorCode.INVALID_SCENE)
