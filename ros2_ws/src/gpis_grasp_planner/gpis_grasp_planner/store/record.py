"""A plan as the bytes that the store keeps: the JSON document, its reserve, its conditions.

They are read by the document's strict reader, so that nothing comes out of the store that could
not have come from a document; nothing is unpickled.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.reserve import LateGrasps, Reserve
from gpis_grasp_planner.plan.document import document_of
from gpis_grasp_planner.plan.document_reader import check_schema, result_from_dict
from gpis_grasp_planner.plan.request import PlanResult
from gpis_grasp_planner.store.conditions import Conditions

_FIELDS = {"plan", "reserve", "conditions"}


@dataclass(frozen=True, eq=False)
class Record:
    """A result with its reserve, and for what it was made."""

    result: PlanResult
    conditions: Conditions

    def as_mapping(self) -> dict[str, Any]:
        """Plain values, ready for JSON."""
        return {**self._head(), "reserve": self._reserve()}

    def packed(self) -> bytes:
        """Compressed JSON, the reserve apart; numbers keep all their digits."""
        return _packed(self._head()) + _packed(self._reserve())

    def _head(self) -> dict[str, Any]:
        return {"plan": document_of(self.result), "conditions": self.conditions.as_mapping()}

    def _reserve(self) -> list[Any]:
        everything = replace(self.result, grasps=tuple(self.result.reserve.estimates))
        reserve: list[Any] = document_of(everything)["grasps"]
        return reserve


def _packed(values: Any) -> bytes:
    text = json.dumps(values, separators=(",", ":"), allow_nan=False)
    return zlib.compress(text.encode(), 6)


def read_record(values: Any, name: str, *, late: bool = False) -> Record:
    """Check plain values of `Record.as_mapping` and build the record.

    Parameters
    ----------
    values : object
    name : str
        For messages.
    late : bool
        Whether the reserve, which few answers need, is read and checked when it is asked for.

    Raises
    ------
    RequestError
        INVALID_DOCUMENT with the field, its value and what it must be.
    """
    if (
        not isinstance(values, dict)
        or set(values) != _FIELDS
        or not all(isinstance(values[name], dict) for name in ("plan", "conditions"))
    ):
        raise _wrong(name, f"it must have the fields {', '.join(sorted(_FIELDS))}")
    plan = values["plan"]
    check_schema(plan, name)
    result, _ = result_from_dict(plan, name)
    spare = values["reserve"]
    if spare:
        there = {**plan, "code": 0, "status": ErrorCode.SUCCESS.name}
        there |= {"grasps": [], "best_attempt": None, "convergence": [], "lost_palms": []}
        estimates = LateGrasps(partial(_grasps, there, spare, f"{name} (reserve)"))
        if not late:
            len(estimates)
        reserve = Reserve(estimates, result.center_of_mass, result.torque_scale, result.cone_edges)
        result = replace(result, reserve=reserve)
    conditions = Conditions.from_mapping(values["conditions"])
    said = conditions.as_mapping()
    made = {
        "mesh_hash": result.mesh_hash,
        "hand": result.hand,
        "planner": result.request.planner,
        "seed": result.request.seed,
        "verification": result.request.verification,
        "max_evaluations": result.request.max_evaluations,
        "friction": [result.friction.finger, result.friction.palm],
    }
    for field, value in made.items():
        if said.get(field) != value:
            raise _wrong(name, f"its plan has {field} {value!r}, its conditions have another")
    return Record(result, conditions)


def unpack(content: bytes, name: str, *, late: bool = False) -> Record:
    """Read what `Record.packed` wrote; parameters and errors as of :func:`read_record`."""
    reader = zlib.decompressobj()
    try:
        values = parse_numbers(reader.decompress(content))
        if isinstance(values, dict) and "reserve" not in values:
            # By itself and still compressed; programs before wrote all in one.
            values["reserve"] = reader.unused_data
    except (zlib.error, ValueError, RecursionError) as error:
        raise _wrong(name, str(error)) from None
    return read_record(values, name, late=late)


def parse_numbers(text: str | bytes) -> Any:
    """Parse JSON without NaN and infinities.

    Raises
    ------
    ValueError, RecursionError
    """

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number of JSON")

    return json.loads(text, parse_constant=refuse)


def _grasps(document: Mapping[str, Any], spare: Any, name: str) -> tuple[Grasp, ...]:
    """The grasps `spare` (a list, or packed) of a document without grasps."""
    if isinstance(spare, bytes):
        try:
            spare = parse_numbers(zlib.decompress(spare))
        except (zlib.error, ValueError, RecursionError) as error:
            raise _wrong(name, str(error)) from None
    return result_from_dict({**document, "grasps": spare}, name)[0].grasps if spare else ()


def _wrong(name: str, why: str) -> RequestError:
    return RequestError(
        f"{name} is no kept plan ({why}). Export it anew from a store that 'verify' finds sound.",
        ErrorCode.INVALID_DOCUMENT,
    )
