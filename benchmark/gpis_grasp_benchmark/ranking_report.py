"""The report of a ranking study: what the first grasp stands, by what the grasps are ordered."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from gpis_grasp_benchmark.markdown import table
from gpis_grasp_benchmark.ranking_runs import MODELS
from gpis_grasp_benchmark.runs import Record
from gpis_grasp_benchmark.shares import MeanInterval, Share, mcnemar
from gpis_grasp_benchmark.study_report import made_by, percent, share_text

EPSILON = "epsilon and volume"
TRIAL = "nominal trial, then epsilon and volume"
TRIALS = "trials on other displacements"
BEST = "(the best there is)"
_FIRST_FEW = 3
_BINS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)

DEFINITIONS = """\
Each object is planned on once; the {tried} best grasps of the answer are ordered anew. Every one
is tried by the strict protocol at friction {friction:g} and {mass_kg:g} kg on the same
{displacements} displacements by {noise_m:g} mm and {noise_deg:g} degrees (uniform directions).
What is compared is the **share of the displacements that the first grasp of an order holds**.

- *{epsilon}*: the planner's order without trials.
- *probability*: `rank_under_uncertainty` with the covariance of the displacements: d^2 / 3 along
  each axis, {sigma_mm:.2f} mm and {sigma_deg:.2f} degrees, about the centre of mass; normally
  distributed, where the trials' displacements are all of the full length.
- *{trial}*: grasps that hold on the part where it was thought come first.
- *{trials}*: the same, then by the share held on {selecting} displacements of another seed.
- *{best}*: chosen with the outcome known, the limit of every order.

Intervals are 95 %: the bootstrap over objects for means and paired differences, Wilson's for
shares of objects; p is McNemar's exact test against the first row, over the objects."""


def ranking_report(records: Sequence[Record], command: str, missing: Sequence[str] = ()) -> str:
    """Write the whole report.

    Parameters
    ----------
    records : sequence of dict
        Of ranking runs with the same settings.
    command : str
    missing : sequence of str
        Objects whose run did not end.
    """
    used = [record for record in records if record["grasps"]]
    blocks = ["# Ranking under an uncertain pose", made_by(records, command)]
    left_out = [record["object_id"] for record in records if not record["grasps"]]
    for what, names in (("Without a grasp", left_out), ("Not finished", missing)):
        if names:
            blocks.append(f"**{what}, and not counted**: {', '.join(names)}.")
    blocks.append("## What is compared\n\n" + _definitions(records[0]))
    if used:
        blocks += [
            "## The first grasp of each order\n\n" + _orders(used),
            "## Does the model predict the trials?\n\n" + _prediction(used),
            "## Objects\n\n" + _objects(used),
            "## Cost\n\n" + _cost(used),
        ]
    return "\n\n".join(blocks) + "\n"


def orders(record: Record) -> dict[str, list[int]]:
    """Indices of a record's grasps, best first, by what orders them."""
    grasps: list[Record] = record["grasps"]
    indices = range(len(grasps))
    found = {EPSILON: list(indices)}
    for model in grasps[0]["probability"]:
        merit = [(-grasp["probability"][model], -grasp["quality"][model]) for grasp in grasps]
        found[f"probability: {model}"] = sorted(indices, key=merit.__getitem__)
    found[TRIAL] = sorted(indices, key=lambda i: not grasps[i]["held"])
    found[TRIALS] = sorted(
        indices, key=lambda i: (not grasps[i]["held"], -sum(grasps[i]["selecting"]))
    )
    found[BEST] = sorted(indices, key=lambda i: -sum(grasps[i]["trials"]))
    return found


def share_held(grasp: Record) -> float:
    """Share of the displacements on which a grasp holds."""
    return float(np.mean(grasp["trials"]))


def _definitions(record: Record) -> str:
    v = record["settings"]["verification"]
    return DEFINITIONS.format(
        epsilon=EPSILON,
        trial=TRIAL,
        trials=TRIALS,
        best=BEST,
        tried=record["tried"],
        displacements=record["displacements"],
        selecting=record["selecting"],
        friction=v["friction"],
        mass_kg=v["mass_kg"],
        noise_m=1e3 * v["noise_m"],
        noise_deg=v["noise_deg"],
        sigma_mm=1e3 * v["noise_m"] / math.sqrt(3.0),
        sigma_deg=v["noise_deg"] / math.sqrt(3.0),
    )


def _orders(records: Sequence[Record]) -> str:
    by_record = [orders(record) for record in records]

    def first(order: str) -> list[float]:
        return [
            share_held(record["grasps"][found[order][0]])
            for record, found in zip(records, by_record, strict=True)
        ]

    def first_few(order: str) -> list[float]:
        return [
            float(np.mean([share_held(record["grasps"][i]) for i in found[order][:_FIRST_FEW]]))
            for record, found in zip(records, by_record, strict=True)
        ]

    base = first(EPSILON)
    rows = []
    for order in by_record[0]:
        shares = first(order)
        mean, few = MeanInterval.of(shares), MeanInterval.of(first_few(order))
        gain = MeanInterval.of([a - b for a, b in zip(shares, base, strict=True)])
        majority = [share > 0.5 for share in shares]
        p = mcnemar(majority, [share > 0.5 for share in base])
        rows.append(
            [
                order,
                percent(mean.mean, mean.low, mean.high),
                "" if order == EPSILON else percent(gain.mean, gain.low, gain.high),
                percent(few.mean, few.low, few.high),
                share_text(Share.of(majority)),
                "" if order == EPSILON else f"{p:.2g}",
            ]
        )
    heads = [
        "ordered by",
        "held by the first",
        "more than by epsilon",
        f"held by the first {_FIRST_FEW}",
        "objects with more than half held",
        "p",
    ]
    return table(heads, rows)


def _prediction(records: Sequence[Record]) -> str:
    grasps = [grasp for record in records for grasp in record["grasps"]]
    shares = [share_held(grasp) for grasp in grasps]
    values = {EPSILON: [grasp["epsilon"] for grasp in grasps]} | {
        model: [grasp["probability"][model] for grasp in grasps]
        for model in grasps[0]["probability"]
    }
    rows = []
    for name, predicted in values.items():
        within = _within_objects(records, name)
        error = "" if name == EPSILON else f"{np.mean(predicted) - np.mean(shares):+.2f}"
        rows.append([name, _correlation(predicted, shares), f"{within:.2f}", error])
    text = (
        f"Spearman's correlation with the share held, over {len(grasps)} grasps of all objects and "
        "as the mean over objects; how far the mean probability is above the mean share.\n\n"
    )
    heads = ["predicted by", "over all", "within objects", "too high by"]
    model = next(iter(MODELS))
    return (
        text
        + table(heads, rows)
        + f"\n\nShare held by the probability of the model '{model}':\n\n"
        + _calibration(values[model], shares)
    )


def _within_objects(records: Sequence[Record], name: str) -> float:
    found = []
    for record in records:
        predicted = [
            g["epsilon"] if name == EPSILON else g["probability"][name] for g in record["grasps"]
        ]
        shares = [share_held(grasp) for grasp in record["grasps"]]
        if len(set(predicted)) > 1 and len(set(shares)) > 1:
            found.append(float(spearmanr(predicted, shares).statistic))
    return float(np.mean(found)) if found else math.nan


def _correlation(predicted: Sequence[float], shares: Sequence[float]) -> str:
    if len(set(predicted)) < 2 or len(set(shares)) < 2:
        return ""
    found = spearmanr(predicted, shares)
    return f"{found.statistic:.2f} (p {found.pvalue:.2g})"


def _calibration(predicted: Sequence[float], shares: Sequence[float]) -> str:
    rows = []
    for low, high in pairwise(_BINS):
        inside = [
            share
            for p, share in zip(predicted, shares, strict=True)
            if low <= p < high or p == high == _BINS[-1]
        ]
        if inside:
            rows.append(
                [f"{low:g} to {high:g}", str(len(inside)), f"{100 * np.mean(inside):.0f} %"]
            )
    return table(["probability", "grasps", "held"], rows)


def _objects(records: Sequence[Record]) -> str:
    names = list(orders(records[0]))
    rows = []
    for record in records:
        found = orders(record)
        cells = [f"{100 * share_held(record['grasps'][found[name][0]]):.0f} %" for name in names]
        rows.append([record["object_id"], str(len(record["grasps"])), *cells])
    return table(["object", "grasps", *names], rows)


def _cost(records: Sequence[Record]) -> str:
    times = [t for r in records for g in r["grasps"] for t in g["trials: elapsed_s"]]
    return (
        f"{len(times)} trials on displaced parts, each until the first direction that fails: "
        f"{np.mean(times):.2f} s of one core on average, median {np.median(times):.2f} s."
    )


def write_ranking_tables(directory: Path, records: Sequence[Record]) -> None:
    """Write ``results.csv`` (a row per grasp) and ``results.json``."""
    rows = [
        {
            "object_id": record["object_id"],
            "object_set": record["object_set"],
            "rank": rank,
            "epsilon": f"{grasp['epsilon']:.4f}",
            "volume": f"{grasp['volume']:.4f}",
            "held": int(grasp["held"]),
            "cause": grasp["cause"],
            **{f"probability: {m}": f"{p:.3f}" for m, p in grasp["probability"].items()},
            "selecting": f"{np.mean(grasp['selecting']):.3f}",
            "share held": f"{share_held(grasp):.3f}",
        }
        for record in records
        for rank, grasp in enumerate(record["grasps"])
    ]
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with (directory / "results.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
    text = json.dumps(list(records), indent=1, allow_nan=False) + "\n"
    (directory / "results.json").write_text(text, encoding="utf-8")
