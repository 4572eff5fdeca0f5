from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from gpis_grasp_benchmark.store import RunStore
from gpis_grasp_planner.errors import ErrorCode, RequestError


def test_what_was_added_is_there_in_another_process(tmp_path: Path, make_run, make_record) -> None:
    store = RunStore(tmp_path / "out")
    assert not store.has(make_run())
    store.add(make_record([0.1]), "{}")
    again = RunStore(tmp_path / "out")
    assert again.has(make_run())
    assert not again.has(make_run(seed=1))
    [record] = again.select([make_run(seed=1), make_run()])
    assert record == make_record([0.1])
    assert again.document_path(record).read_text() == "{}"


def test_a_half_written_last_line_is_a_run_not_made(tmp_path: Path, make_run, make_record) -> None:
    store = RunStore(tmp_path)
    store.add(make_record([0.1], seed=0), "{}")
    store.add(make_record([0.2], seed=1), "{}")
    file = tmp_path / "runs.jsonl"
    data = file.read_bytes()
    for cut in (1, 10, len(data.splitlines()[1])):
        file.write_bytes(data[:-cut])
        again = RunStore(tmp_path)
        assert again.has(make_run(seed=0))
        assert not again.has(make_run(seed=1))
        again.add(make_record([0.3], seed=1), "{}")
        assert [json.loads(x)["epsilon"] for x in file.read_text().splitlines()] == [[0.1], [0.3]]


@pytest.mark.parametrize("line", ["{", "[]", "{}", "nonsense"])
def test_a_damaged_line_is_named(tmp_path: Path, make_record, line: str) -> None:
    RunStore(tmp_path).add(make_record([0.1]), "{}")
    file = tmp_path / "runs.jsonl"
    file.write_text(file.read_text() + line + "\n")
    with pytest.raises(RequestError, match="Line 2") as caught:
        RunStore(tmp_path)
    assert caught.value.code == ErrorCode.INVALID_DOCUMENT


def test_the_results_hold_every_run_with_settings_and_versions(tmp_path: Path, make_record) -> None:
    records = [make_record([0.1, 0.3], [0.01, 0.02]), make_record([], planner="random", seed=1)]
    RunStore(tmp_path).write_results(records)
    assert json.loads((tmp_path / "results.json").read_text()) == records
    with (tmp_path / "results.csv").open() as file:
        first, second = csv.DictReader(file)
    assert float(first["mean_epsilon"]) == pytest.approx(0.4 / 20)
    assert (float(first["best_epsilon"]), float(first["best_volume"])) == (0.3, 0.02)
    assert (first["friction_finger"], first["friction_palm"]) == ("0.3", "0.2")
    assert first["settings_hash"] == records[0]["settings_hash"]
    assert (first["version"], first["source"]) == (records[0]["version"], "aa")
    assert (second["planner"], second["grasps_found"], second["best_epsilon"]) == (
        "random",
        "0",
        "0.0",
    )
