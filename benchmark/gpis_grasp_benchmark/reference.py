"""Figures of others to stand beside ours: the paper's tables, and its simulator's own planners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gpis_grasp_benchmark.objects import read_facts

ORIGINAL = "graspit"
_EXTENT_TOLERANCE_MM = 0.3


@lru_cache(maxsize=1)
def published() -> Mapping[str, Any]:
    """All of ``graspit.yaml``; its first lines say where each figure is from."""
    path = Path(__file__).with_name("graspit.yaml")
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def object_facts() -> dict[str, dict[str, Any]]:
    """Mass, centre of gravity and friction of the original simulator's five objects."""
    return {name: dict(facts) for name, facts in published()["objects"].items()}


def facts_of(source: str | None) -> dict[str, dict[str, Any]] | None:
    """Facts of --facts: a YAML file, or 'graspit' for the original simulator's objects."""
    if source is None:
        return None
    return object_facts() if source == ORIGINAL else read_facts(Path(source))


def is_original(object_id: str, extent_m: Sequence[float]) -> bool:
    """Whether an object is the original simulator's: by name and size, not by name alone.

    The shipped parts have a mug and a flask, too, which are others.
    """
    extent = published()["extent_mm"].get(object_id)
    if extent is None:
        return False
    return bool(np.allclose(1e3 * np.asarray(extent_m), extent, atol=_EXTENT_TOLERANCE_MM))


def beside(planner: str) -> list[str]:
    """Columns of others that belong beside a planner of ours."""
    return [theirs for theirs, ours in published()["beside"].items() if planner in ours]
