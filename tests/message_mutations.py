"""Messages made bad in a random place: any field of any depth, by its type."""

from __future__ import annotations

import math
import random
import re
from importlib import import_module
from typing import Any

FLOATS = (
    math.nan, math.inf, -math.inf, 0.0, -0.0, 1.0, -1.0, 1e-320, 1e-12, 1e12, 1e154, 1e308, -1e308,
)  # fmt: skip
TEXTS = (
    "", " ", ".", "..", "../mug", "/etc/passwd", "%2e%2e%2fmug", "mug ", "MUG", "mugg", "a\nb",
    "\x1b[31m", "{}", "%s%n", "$(id)", "'; --", "ä" * 20, "\U0001f916", "x" * 255, "x" * 70_000,
    "sphere", "mug", "world", "none", "rank", "hpp", "magic",
)  # fmt: skip
_INTEGER = re.compile(r"(u?)int(\d+)")
_SEQUENCE = re.compile(r"sequence<([^,>]+)(?:, \d+)?>")
MOST_ELEMENTS = 40


def mutate(message: Any, rng: random.Random, n: int = 1) -> list[str]:
    """Change `n` random fields of a message in place; the names of those that were changed."""
    return [_mutate_once(message, rng, "") for _ in range(n)]


def _mutate_once(message: Any, rng: random.Random, path: str) -> str:
    name, kind = rng.choice(sorted(message.get_fields_and_field_types().items()))
    value = getattr(message, name)
    if hasattr(value, "get_fields_and_field_types"):
        return _mutate_once(value, rng, f"{path}{name}.")
    setattr(message, name, _value(kind, value, rng))
    return path + name


def _value(kind: str, value: Any, rng: random.Random) -> Any:
    if kind in ("double", "float"):
        return rng.choice([*FLOATS[: 9 if kind == "float" else None], rng.gauss(0.0, 1.0)])
    if kind == "boolean":
        return not value
    if kind.startswith("string"):
        return rng.choice(TEXTS)
    if match := _INTEGER.fullmatch(kind):
        bits, low = int(match[2]), 0 if match[1] else -(2 ** (int(match[2]) - 1))
        high = low + 2**bits - 1
        return rng.choice([low, high, max(low, -1), 0, 1, rng.randint(low, high)])
    if match := _SEQUENCE.fullmatch(kind):
        number = rng.choice([0, 1, 2, rng.randrange(MOST_ELEMENTS)])
        return [_element(match[1], rng) for _ in range(number)]
    changed = list(value)  # an array of fixed length
    changed[rng.randrange(len(changed))] = _value(kind.split("[")[0], None, rng)
    return changed


def _element(kind: str, rng: random.Random) -> Any:
    if "/" not in kind:
        return _value(kind, False, rng)
    package, name = kind.split("/")
    message = getattr(import_module(f"{package}.msg"), name)()
    mutate(message, rng, rng.randrange(8))
    return message
