"""Finished runs on disk: one JSON line each, so that an interrupted benchmark goes on.

``runs.jsonl`` grows by a line per run and is never rewritten; ``documents/`` holds the grasps of
each run; ``results.csv`` and ``results.json`` are made from it at the end.
"""

from __future__ import annotations

import csv
import json
import os
import threading
from collections.abc import Iterable, Sequence
from pathlib import Path

from gpis_grasp_benchmark.runs import Record, Task
from gpis_grasp_benchmark.tables import mean_of_best
from gpis_grasp_planner.errors import ErrorCode, RequestError

CSV_COLUMNS = (
    "object_id", "planner", "seed", "time_budget_s", "max_evaluations", "n_grasps",
    "friction_finger", "friction_palm", "status", "grasps_found", "mean_epsilon", "mean_volume",
    "best_epsilon", "best_volume", "n_evaluations", "elapsed_s", "cpu_s", "evaluations_per_s",
    "object_hash", "settings_hash", "version", "source", "key",
)  # fmt: skip


class RunStore:
    """The records of an output directory.

    Parameters
    ----------
    directory : Path
        Made if it is not there.

    Raises
    ------
    RequestError
        INVALID_DOCUMENT if a line other than the last is damaged.
    """

    def __init__(self, directory: Path):
        self.directory = directory
        self._lock = threading.Lock()
        self._file = directory / "runs.jsonl"
        (directory / "documents").mkdir(parents=True, exist_ok=True)
        self._records = self._read()

    @property
    def records(self) -> dict[str, Record]:
        """Records by key."""
        return dict(self._records)

    def has(self, run: Task) -> bool:
        """Whether the run was made before."""
        return run.key in self._records

    def select(self, runs: Iterable[Task]) -> list[Record]:
        """Return the records of those runs that were made."""
        return [self._records[run.key] for run in runs if run.key in self._records]

    def document_path(self, record: Record) -> Path:
        """Where the grasps of a run are."""
        name = f"{record['object_id']}-{record['planner']}-{record['seed']}-{record['key']}.json"
        return self.directory / "documents" / name

    def add(self, record: Record, document: str) -> None:
        """Keep a finished run; on return it is on the disk. Safe to call from threads."""
        with self._lock:
            self.document_path(record).write_text(document, encoding="utf-8")
            with self._file.open("a", encoding="utf-8") as file:
                file.write(json.dumps(record, allow_nan=False) + "\n")
                file.flush()
                os.fsync(file.fileno())
            self._records[record["key"]] = record

    def write_results(self, records: Sequence[Record]) -> None:
        """Write ``results.csv`` and ``results.json``, with every setting and version."""
        with (self.directory / "results.csv").open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, CSV_COLUMNS)
            writer.writeheader()
            writer.writerows(_row(record) for record in records)
        (self.directory / "results.json").write_text(
            json.dumps(list(records), indent=1, allow_nan=False) + "\n", encoding="utf-8"
        )

    def _read(self) -> dict[str, Record]:
        if not self._file.exists():
            return {}
        data = self._file.read_bytes()
        lines = data.split(b"\n")
        records = {}
        for number, line in enumerate(lines[:-1], start=1):
            try:
                record = json.loads(line)
                records[record["key"]] = record
            except (ValueError, KeyError, TypeError):
                raise RequestError(
                    f"Line {number} of {self._file} is damaged. Remove the line (its run is made "
                    "again), or choose another directory with --out.",
                    ErrorCode.INVALID_DOCUMENT,
                ) from None
        if lines[-1]:
            # An interruption in the middle of writing: that run is made again.
            with self._file.open("r+b") as file:
                file.truncate(len(data) - len(lines[-1]))
        return records


def _row(record: Record) -> Record:
    best = max(range(len(record["epsilon"])), key=record["epsilon"].__getitem__, default=None)
    known = {name: record[name] for name in CSV_COLUMNS if name in record}
    return {
        **known,
        "friction_finger": record["friction"]["finger"],
        "friction_palm": record["friction"]["palm"],
        "grasps_found": len(record["epsilon"]),
        "mean_epsilon": mean_of_best(record, "epsilon"),
        "mean_volume": mean_of_best(record, "volume"),
        "best_epsilon": 0.0 if best is None else record["epsilon"][best],
        "best_volume": 0.0 if best is None else record["volume"][best],
        "evaluations_per_s": record["n_evaluations"] / record["elapsed_s"],
        "source": record["environment"]["source"],
    }
