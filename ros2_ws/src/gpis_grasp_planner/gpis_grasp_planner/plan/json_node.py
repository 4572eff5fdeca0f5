"""Values of a JSON document with the path to them: each read checks the kind and the limits."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, RequestError

Array = NDArray[np.float64]

UNIT_TOLERANCE = 1e-6
_LARGEST = 1e300


def are_plain(values: Sequence[Any]) -> bool:
    """Whether all values are floating-point numbers within the limits of :meth:`Node.number`."""
    if {*map(type, values)} != {float}:
        return False
    return sum(values) == sum(values) and min(values) > -_LARGEST and max(values) < _LARGEST


class Node:
    """A value of the document together with the path to it, for messages."""

    def __init__(self, value: Any, path: str, document: str):
        self.value = value
        self.path = path
        self.document = document

    def fail(self, must: str) -> RequestError:
        """Say where, what was found, and what it must be."""
        where = f"'{self.path}'" if self.path else "The document"
        return RequestError(
            f"{self.document}: {where} is {reprlib.repr(self.value)}; it must be {must}.",
            ErrorCode.INVALID_DOCUMENT,
        )

    def object(
        self, names: frozenset[str], later: Mapping[str, Any] | None = None
    ) -> dict[str, Node]:
        """An object with exactly these fields; `later` has those that earlier programs wrote none.

        Their values stand for what is not there.
        """
        if not isinstance(self.value, Mapping):
            raise self.fail(f"an object with the fields {', '.join(sorted(names))}")
        values = {**later, **self.value} if later else self.value
        if values.keys() != names:
            missing = sorted(names - set(values))
            unknown = sorted(str(name)[:40] for name in set(values) - names)
            fault = f"lacks {', '.join(missing)}" if missing else f"has unknown {unknown}"
            where = f"'{self.path}'" if self.path else "the document"
            raise RequestError(
                f"{self.document}: {where} {fault}; its fields are {', '.join(sorted(names))}.",
                ErrorCode.INVALID_DOCUMENT,
            )
        prefix = f"{self.path}." if self.path else ""
        return {n: Node(v, f"{prefix}{n}", self.document) for n, v in values.items()}

    def list(self) -> list[Node]:
        """Return the items of a list."""
        if not isinstance(self.value, list):
            raise self.fail("a list")
        return [Node(v, f"{self.path}[{i}]", self.document) for i, v in enumerate(self.value)]

    def text(self) -> str:
        """Return a text."""
        if not isinstance(self.value, str):
            raise self.fail("a text")
        return self.value

    def texts(self) -> tuple[str, ...]:
        """Return a list of texts."""
        return tuple(item.text() for item in self.list())

    def boolean(self) -> bool:
        """Return true or false."""
        if not isinstance(self.value, bool):
            raise self.fail("true or false")
        return self.value

    def number(self, low: float = -math.inf, high: float = math.inf) -> float:
        """A finite number within bounds, both included."""
        value = self.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.fail("a number")
        if not (abs(value) < _LARGEST and low <= value <= high):
            raise self.fail(f"a finite number from {low:g} to {high:g}")
        return float(value)

    def integer(self, low: int = 0, high: int = 2**63 - 1) -> int:
        """A whole number within bounds, both included."""
        value = self.value
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.fail(f"an integer from {low} to {high}")
        return value

    def vector(self, n: int) -> Array:
        """A list of `n` numbers."""
        value = self.value
        # Nearly all that is read are these: seen at once, without a node for each number.
        if isinstance(value, list) and len(value) == n and are_plain(value):
            return np.array(value)
        items = self.list()
        if len(items) != n:
            raise self.fail(f"a list of {n} numbers")
        return np.array([item.number() for item in items], dtype=float)

    def unit_vector(self, n: int) -> Array:
        """A list of `n` numbers of length 1, normalised to the last digit."""
        vector = self.vector(n)
        length = math.sqrt(vector @ vector)
        if abs(length - 1.0) > UNIT_TOLERANCE:
            raise self.fail(f"of length 1 (it has {length:.9g})")
        return vector

    def optional(self, read: Callable[[Node], Any]) -> Any:
        """Read null as None, all else by `read`."""
        return None if self.value is None else read(self)
