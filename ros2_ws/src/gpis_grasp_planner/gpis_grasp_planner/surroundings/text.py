"""Scenes as people write them down: YAML, of which JSON is a part."""

from __future__ import annotations

from typing import Any

import yaml

from gpis_grasp_planner.errors import ErrorCode, RequestError


def parse_scene(text: str, what: str) -> Any:
    """Plain values of a text; what they must be is for the caller to check.

    Parameters
    ----------
    text : str
    what : str
        Where the text is from, for the message.

    Raises
    ------
    RequestError
        INVALID_SCENE with the line, where it is no YAML.
    """
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" (line {mark.line + 1})" if mark is not None else ""
        raise RequestError(
            f"{what} is neither YAML nor JSON{where}. Correct it; docs/clearance.md has the form.",
            ErrorCode.INVALID_SCENE,
        ) from None
