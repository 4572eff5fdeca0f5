"""From the records of a success study to a verdict per object and test, with its cause."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import zip_longest
from pathlib import Path

from gpis_grasp_benchmark.bullet_objects import Refusal
from gpis_grasp_benchmark.runs import Record
from gpis_grasp_benchmark.strict_tests import NOISE, NOMINAL, TESTS

REFUSED, NOT_PLANNABLE = "refused mesh", "not plannable"


@dataclass(frozen=True)
class Verdict:
    """Of an object's first grasp in one test.

    Attributes
    ----------
    held : bool
        Under pose noise: more than half of the displacements.
    cause : str
        Empty where it held; under pose noise the most frequent one.
    share : float
        Of the trials; 0 or 1 but for pose noise.
    """

    held: bool
    cause: str
    share: float


@dataclass(frozen=True)
class Outcome:
    """What came of one object.

    Attributes
    ----------
    object_id, object_set : str
    verdicts : mapping of str to Verdict
        By test, for every test.
    graspable : bool
        Whether any grasp of any planner passed the nominal test.
    message : str
        Of the refusal, or of the planner where it found nothing.
    """

    object_id: str
    object_set: str
    verdicts: dict[str, Verdict]
    graspable: bool
    message: str


def outcomes(records: Sequence[Record], refused: Sequence[Refusal]) -> list[Outcome]:
    """One per object, the refused ones last."""
    found = [_outcome(record) for record in records]
    return found + [
        Outcome(r.object_id, r.object_set, _all_failed(REFUSED), False, r.message) for r in refused
    ]


def _outcome(record: Record) -> Outcome:
    plan = record["plans"][0]
    graspable = any(row["held"] for row in record["trials"] if row["test"] == NOMINAL)
    first = [r for r in record["trials"] if r["rank"] == 0 and r["planner"] == plan["planner"]]
    if first:
        verdicts = {test: _verdict([r for r in first if r["test"] == test]) for test in TESTS}
    else:
        verdicts = _all_failed(NOT_PLANNABLE)
    return Outcome(
        record["object_id"],
        record["object_set"],
        verdicts,
        graspable,
        "" if first else plan["message"],
    )


def _verdict(rows: Sequence[Record]) -> Verdict:
    share = sum(row["held"] for row in rows) / len(rows)
    held = share > 0.5
    causes = Counter(row["cause"] for row in rows if not row["held"])
    return Verdict(held, "" if held else causes.most_common(1)[0][0], share)


def _all_failed(cause: str) -> dict[str, Verdict]:
    return dict.fromkeys(TESTS, Verdict(False, cause, 0.0))


def write_tables(
    directory: Path,
    records: Sequence[Record],
    refused: Sequence[Refusal],
) -> None:
    """Write ``results.csv`` (a row per object) and ``results.json`` (every trial)."""
    rows = []
    for outcome, record in zip_longest(outcomes(records, refused), records):
        row = {"object_id": outcome.object_id, "object_set": outcome.object_set}
        if record is not None:  # the refused ones have none
            row |= _facts(record)
        row["graspable"] = outcome.graspable
        for test, verdict in outcome.verdicts.items():
            row[test] = f"{verdict.share:.3g}" if test == NOISE else int(verdict.held)
            row[f"{test}: cause"] = verdict.cause
        rows.append(row | {"message": outcome.message})
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with (directory / "results.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
    values = {"records": list(records), "refused": [asdict(refusal) for refusal in refused]}
    text = json.dumps(values, indent=1, allow_nan=False) + "\n"
    (directory / "results.json").write_text(text, encoding="utf-8")


def _facts(record: Record) -> Record:
    plan = record["plans"][0]
    first: Record = next((row for row in record["trials"] if row["rank"] == 0), {})
    return {
        "extent_mm": " x ".join(f"{1e3 * side:.0f}" for side in record["extent_m"]),
        "faces": record["faces"],
        "cad_mass_kg": f"{record['cad_mass_kg']:.3g}",
        "planner": plan["planner"],
        "status": plan["status"],
        "planning_s": f"{plan['elapsed_s']:.2f}",
        "evaluations": plan["evaluations"],
        "grasps": len(plan["epsilon"]),
        "epsilon": f"{plan['epsilon'][0]:.4f}" if plan["epsilon"] else "",
        "said_to_hold": plan["said_to_hold"][0] if plan["said_to_hold"] else "",
        "penetration_mm": f"{first['penetration_mm']:.3f}" if first else "",
        "slip_mm": f"{first['slip_mm']:.2f}" if first else "",
        "turn_deg": f"{first['turn_deg']:.2f}" if first else "",
    }
