"""A plan as the bytes that the store keeps: the JSON document, its reserve, its conditions.

They are read by the document's strict reader, so that nothing comes out of the store that could
not have come from a document; nothing is unpickled.
"""

from __future__ import annotations

import json
import zlib
from dataclasses import dataclass, replace
from typing import Any

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.grasp.reserve import Reserve
from gpis_grasp_planner.plan.document import document_of
from gpis_grasp_planner.plan.document_reader import parse_document, result_from_dict
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
        everything = replace(self.result, grasps=self.result.reserve.estimates)
        return {
            "plan": document_of(self.result),
            "reserve": document_of(everything)["grasps"],
            "conditions": self.conditions.as_mapping(),
        }

    def packed(self) -> bytes:
        """Compressed JSON; numbers keep all their digits."""
        text = json.dumps(self.as_mapping(), separators=(",", ":"), allow_nan=False)
        return zlib.compress(text.encode(), 6)


def read_record(values: Any, name: str) -> Record:
    """Check plain values of `Record.as_mapping` and build the record.

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
    plan = parse_document(json.dumps(values["plan"]).encode(), name)
    result, _ = result_from_dict(plan, name)
    spare = values["reserve"]
    if spare:
        there = {**plan, "grasps": spare, "code": 0, "status": ErrorCode.SUCCESS.name}
        estimates = result_from_dict(there, f"{name} (reserve)")[0].grasps
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


def unpack(content: bytes, name: str) -> Record:
    """Read what `Record.packed` wrote; raises as :func:`read_record`."""
    try:
        values = json.loads(zlib.decompress(content))
    except (zlib.error, ValueError, RecursionError) as error:
        raise _wrong(name, str(error)) from None
    return read_record(values, name)


def _wrong(name: str, why: str) -> RequestError:
    return RequestError(
        f"{name} is no kept plan ({why}). Export it anew from a store that 'verify' finds sound.",
        ErrorCode.INVALID_DOCUMENT,
    )
