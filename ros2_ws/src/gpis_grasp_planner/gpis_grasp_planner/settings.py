"""Settings declared once: type, default, bounds, unit and description, next to each other.

A group of settings is a frozen dataclass whose fields are made by :func:`setting`. The ROS
parameters, the command line and ``docs/parameters.md`` are all derived from the same fields by
:func:`describe`; nobody repeats a default or a bound.

Example
-------
>>> @dataclass(frozen=True)
... class ShellSettings(SettingsGroup):
...     clearance_m: float = setting(0.12, low=0.0, high=1.0, description="Outer shell offset.")
>>> ShellSettings(clearance_m=0.2).clearance_m
0.2
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, asdict, dataclass, field, fields
from typing import Any, Self, get_type_hints

from gpis_grasp_planner.errors import RequestError


def setting(
    default: Any,
    *,
    description: str,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] | None = None,
    common: bool = False,
) -> Any:
    """Declare one setting (a dataclass field). Units are the suffix of the field's name.

    Parameters
    ----------
    default : bool, int, float, str or tuple of str
    description : str
        One sentence, shown to users as it is.
    low, high : float, optional
        Inclusive bounds of a number.
    choices : tuple of str, optional
        The allowed values of a string.
    common : bool
        Whether users change it; the others are of those who study the method.
    """
    metadata = {
        "description": description,
        "low": low,
        "high": high,
        "choices": choices,
        "common": common,
    }
    return field(default=default, metadata=metadata)


# A type as a person calls it.
_KINDS = {
    bool: "true or false",
    int: "a whole number (int)",
    float: "a number (float)",
    str: "a text",
    tuple: "a list of texts",
}


def _written(value: Any) -> str:
    """A value as one writes it in YAML, ROS parameters and --set."""
    if isinstance(value, bool):
        return str(value).lower()
    return repr(list(value)) if isinstance(value, tuple) else repr(value)


@dataclass(frozen=True)
class SettingInfo:
    """What is known of one setting: enough for a ROS parameter, an option and a doc line."""

    name: str
    type: type
    default: Any
    description: str
    low: float | None
    high: float | None
    choices: tuple[str, ...] | None
    common: bool = False

    def check(self, value: Any) -> Any:
        """Return `value` in the declared type, or raise RequestError with value and limit."""
        if self.type is float and isinstance(value, int) and not isinstance(value, bool):
            try:
                value = float(value)
            except OverflowError:
                value = math.inf
        if self.type is tuple and isinstance(value, list):
            value = tuple(value)
        wrong_item = isinstance(value, tuple) and not all(isinstance(v, str) for v in value)
        if (
            not isinstance(value, self.type)
            or (isinstance(value, bool) and self.type is not bool)
            or wrong_item
        ):
            raise RequestError(
                f"Setting '{self.name}' is {value!r}; it takes {_KINDS[self.type]}, such as the "
                f"default {_written(self.default)}."
            )
        if isinstance(value, float) and not math.isfinite(value):
            raise RequestError(
                f"Setting '{self.name}' is {value}; it must be finite. "
                f"The default is {self.default!r}."
            )
        if isinstance(value, int | float) and not self._in_range(value):
            raise RequestError(
                f"Setting '{self.name}' is {value!r}, outside {self.range_text()}. "
                f"The default is {self.default!r}."
            )
        if self.choices is not None and value not in self.choices:
            raise RequestError(
                f"Setting '{self.name}' is {value!r}; choose one of {', '.join(self.choices)}."
            )
        return value

    def _in_range(self, value: float) -> bool:
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        return low <= value <= high

    def range_text(self) -> str:
        """The allowed values as text, for messages and docs."""
        if self.choices is not None:
            return ", ".join(self.choices)
        if self.low is None and self.high is None:
            return "any"
        low = "-inf" if self.low is None else f"{self.low:g}"
        high = "inf" if self.high is None else f"{self.high:g}"
        return f"[{low}, {high}]"


@dataclass(frozen=True)
class SettingsGroup:
    """Base of the settings dataclasses: checks every field when it is made."""

    def __post_init__(self) -> None:
        for info in describe(type(self)):
            object.__setattr__(self, info.name, info.check(getattr(self, info.name)))

    def as_dict(self) -> dict[str, Any]:
        """The values by name, as JSON has them: lists for tuples."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> Self:
        """Build from names and values; an unknown name is an error that lists the known ones."""
        known = {f.name for f in fields(cls)}
        unknown = sorted(set(values) - known)
        if unknown:
            raise RequestError(
                f"Unknown setting {', '.join(unknown)}; known are {', '.join(sorted(known))}."
            )
        return cls(**values)


def describe(group: type[SettingsGroup]) -> list[SettingInfo]:
    """The settings of a group, in the order of their declaration."""
    if group not in _DESCRIBED:
        hints = get_type_hints(group)
        _DESCRIBED[group] = tuple(_info(f, hints[f.name]) for f in fields(group))
    return list(_DESCRIBED[group])


_DESCRIBED: dict[type[SettingsGroup], tuple[SettingInfo, ...]] = {}


def _info(f: Field[Any], hint: Any) -> SettingInfo:
    if f.default is MISSING or "description" not in f.metadata:
        raise TypeError(f"field {f.name} must be declared with setting(...)")
    return SettingInfo(
        name=f.name,
        type=getattr(hint, "__origin__", hint),
        default=f.default,
        description=f.metadata["description"],
        low=f.metadata["low"],
        high=f.metadata["high"],
        choices=f.metadata["choices"],
        common=f.metadata["common"],
    )
