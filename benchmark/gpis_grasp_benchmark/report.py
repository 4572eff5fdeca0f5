"""The report as Markdown: the paper's two tables, speed, success, ratios, and how it was made."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from gpis_grasp_benchmark import reference
from gpis_grasp_benchmark.markdown import table
from gpis_grasp_benchmark.tables import (
    Estimate,
    Record,
    Summary,
    mean_over_objects,
    ratio,
    summarise,
)

# The baselines of the ratio columns, where they took part.
BASELINES = ("eigengrasp", "annealing", "random")

DEFINITIONS = """\
- **Epsilon, volume**: of the convex hull of the wrenches of all contacts' friction pyramids
  (8 edges unless the settings say otherwise), torques over the largest distance of the surface
  from the centre of mass; recomputable from `documents/`.
- **Mean of {n} best**: over the {n} best mutually distinct grasps of a run (0.2 apart in
  max(translation / maxRadius, angle / 2 pi)). Where fewer were found, **each missing grasp counts
  as 0**.
- **Best of {n}**: the grasp with the largest epsilon of a run, with its volume.
- **±** is the half width of the 95 % confidence interval of the mean over seeds (Student's t);
  none for a single seed.
- **A run** is one process with one thread. The budget covers everything from the loaded mesh on:
  surface, distance field, search and the exact quality of the answer; loading compiled code is
  outside. Evaluations per second are grasps closed and judged over that whole time; states
  that a planner judges without closing the hand (EigenGrasp's potential) are not among them."""


@dataclass(frozen=True)
class Illustrations:
    """Files beside the report, by object: paths relative to it."""

    convergence: Mapping[str, str] = field(default_factory=dict)
    pictures: Mapping[str, str] = field(default_factory=dict)


def report(
    records: Sequence[Record], command: str, illustrations: Illustrations | None = None
) -> str:
    """Write the whole report.

    Parameters
    ----------
    records : sequence of dict
        Finished runs, all with the same number of grasps.
    command : str
        The command that made them.
    illustrations : Illustrations, optional
    """
    summaries = summarise(records)
    originals = {
        r["object_id"] for r in records if reference.is_original(r["object_id"], r["extent_m"])
    }
    n = records[0]["n_grasps"]
    blocks = [
        "# Benchmark of the planners",
        _made_by(records, command),
        f"## Definitions\n\n{DEFINITIONS.format(n=n)}",
        f"## Mean of the {n} best\n\n" + _mean_table(summaries, originals),
        f"## Best of the {n}\n\n" + _best_table(summaries, originals),
        "## Speed and success\n\n" + _speed_table(summaries),
    ]
    ratios = _ratio_table(summaries)
    if ratios:
        blocks.append("## Ratios over all objects\n\n" + ratios)
    if originals:
        blocks.append("## Figures of others\n\n" + _others())
    blocks += _illustrations(illustrations or Illustrations())
    return "\n\n".join(blocks) + "\n"


def _made_by(records: Sequence[Record], command: str) -> str:
    def all_of(values: Iterable[object]) -> str:
        return ", ".join(dict.fromkeys(str(v) for v in values))

    environments = [r["environment"] for r in records]
    limits = {r["max_evaluations"] for r in records}
    budget = (
        f"{all_of(r['time_budget_s'] for r in records)} s per run"
        if limits == {None}
        else f"equal evaluations: {all_of(limits)} per run"
    )
    frictions = {
        r["object_id"]: f"{r['friction']['finger']:g} / {r['friction']['palm']:g}" for r in records
    }
    sources = dict.fromkeys(e["source"] for e in environments)
    seeds = all_of(sorted({r["seed"] for r in records}))
    settings = all_of(r["settings_hash"] for r in records)
    lines = [
        f"    {command}",
        "",
        f"- {len(records)} runs: {len(frictions)} objects, planners "
        f"{all_of(r['planner'] for r in records)}, seeds {seeds}; {budget}, one core each.",
        "- Friction (finger / palm): "
        + ", ".join(f"{name} {values}" for name, values in frictions.items())
        + ".",
        f"- Version {all_of(r['version'] for r in records)}, sources {', '.join(sources)}, "
        f"settings {settings} (in full in `results.json`).",
        "- "
        + "; ".join(
            f"{name} {all_of(e[name] for e in environments)}"
            for name in ("cpu", "python", "numpy", "scipy", "numba")
        )
        + ".",
    ]
    if len(sources) > 1:
        lines.append(
            f"- **These runs come from {len(sources)} states of the sources**: they can be "
            "compared only as far as nothing of weight changed between them."
        )
    busy = [r for r in records if r["cpu_s"] < 0.9 * r["elapsed_s"]]
    if busy:
        lines.append(
            f"- {len(busy)} runs had the core for less than 90 % of their time: the machine was "
            "doing something else as well."
        )
    return "\n".join(lines)


def _mean_table(summaries: Sequence[Summary], originals: set[str]) -> str:
    planners = {s.planner for s in summaries}
    baselines = [name for name in BASELINES if name in planners and len(planners) > 1]
    heads = ["object", "planner", "epsilon", "volume"]
    heads += [f"{q} / {name}'s" for name in baselines for q in ("eps", "vol")]
    heads += ["measured in another simulator: eps / vol"] if originals else []
    rows = []
    by_key = {(s.object_id, s.planner): s for s in summaries}
    for s in summaries:
        row = [s.object_id, s.planner, _estimate(s.mean_epsilon), _estimate(s.mean_volume)]
        for name in baselines:
            other = by_key.get((s.object_id, name))
            for quality in ("mean_epsilon", "mean_volume"):
                if other is None or name == s.planner:
                    row.append("")
                else:
                    row.append(_times(getattr(s, quality).mean, getattr(other, quality).mean))
        if originals:
            row.append(_theirs(s, "mean") if s.object_id in originals else "")
        rows.append(row)
    return table(heads, rows)


def _best_table(summaries: Sequence[Summary], originals: set[str]) -> str:
    heads = ["object", "planner", "epsilon", "volume", "epsilon, best of all seeds"]
    heads += ["measured in another simulator: eps / vol"] if originals else []
    rows = []
    for s in summaries:
        row = [s.object_id, s.planner, _estimate(s.best_epsilon), _estimate(s.best_volume)]
        row.append(_number(s.best_epsilon_of_any_seed))
        if originals:
            row.append(_theirs(s, "best") if s.object_id in originals else "")
        rows.append(row)
    return table(heads, rows)


def _speed_table(summaries: Sequence[Summary]) -> str:
    heads = ["object", "planner", "grasps found", "runs with a grasp", "evaluations", "per second"]
    rows = [
        [
            s.object_id,
            s.planner,
            f"{s.found.mean:.1f} of {s.n_grasps}",
            f"{s.successes} of {s.seeds}",
            f"{s.n_evaluations.mean:.0f}",
            f"{s.evaluations_per_s.mean:.0f}",
        ]
        for s in summaries
    ]
    return table(heads, rows)


def _ratio_table(summaries: Sequence[Summary]) -> str:
    planners = list(dict.fromkeys(s.planner for s in summaries))
    baselines = [name for name in BASELINES if name in planners]
    if not baselines or len(planners) < 2:
        return ""
    heads = ["planner", "mean epsilon", "mean volume"]
    heads += [f"{q} / {name}'s" for name in baselines for q in ("eps", "vol")]
    rows = []
    for planner in planners:
        means = {q: mean_over_objects(summaries, planner, q) for q in ("epsilon", "volume")}
        row = [planner, _number(means["epsilon"]), _number(means["volume"])]
        for name in baselines:
            common = _measured_with_both(summaries, planner, name)
            for quality in means:
                pair = (mean_over_objects(common, which, quality) for which in (planner, name))
                row.append("" if name == planner else _times(*pair))
        rows.append(row)
    text = "The mean of the best, averaged over the objects first and divided then.\n\n"
    return text + table(heads, rows) + "\n\n" + _paper_ratio()


def _measured_with_both(summaries: Sequence[Summary], *planners: str) -> list[Summary]:
    """Summaries of those objects that each of the planners was tried on."""
    objects = [{s.object_id for s in summaries if s.planner == name} for name in planners]
    return [s for s in summaries if s.object_id in set.intersection(*objects)]


def _paper_ratio() -> str:
    paper, printed = reference.published()["paper_mean"], reference.published()["paper_ratio"]
    said = []
    for index, quality in enumerate(("epsilon", "volume")):
        ours, theirs = (
            sum(values[index] for values in paper[name].values())
            for name in ("HPP-Opt", "EigenGrasp")
        )
        said.append(
            f"{quality} {printed[quality]:g} (this formula on its table: {ours / theirs:.1f})"
        )
    return (
        "The paper states for HPP-Opt over EigenGrasp, in another simulator: "
        + ", ".join(said)
        + "."
    )


def _others() -> str:
    seconds = reference.published()["simulator_seconds"]
    limits = reference.published()["limit_eight_contacts"]
    return (
        "The columns 'measured in another simulator' are not ours. *Random Alg*, *EigenGrasp*, "
        "*HPP-Opt* and *ADMM-CP-Opt* are printed in the paper (20 s, GraspIt!). *Simulator* "
        "figures were measured with GraspIt!'s own planners on its own five objects with the "
        "Barrett hand at the same friction, 5 seeds ("
        + ", ".join(f"{name.removeprefix('simulator ')} {s} s" for name, s in seconds.items())
        + ", the two-level planner multi-threaded); its best is the best epsilon of any seed, and "
        "its sphere was elastic with soft contacts, ours has point contacts.\n\nBest epsilon of "
        "any eight point contacts, without a hand (a lower bound of the limit): "
        + ", ".join(f"{name} {value:g}" for name, value in limits.items())
        + "."
    )


def _theirs(summary: Summary, which: str) -> str:
    figures = []
    for name in reference.beside(summary.planner):
        if name.startswith("simulator"):
            mean_eps, mean_vol, best_eps, found = reference.published()["simulator"][name][
                summary.object_id
            ]
            figures.append(
                f"{name} {_number(mean_eps)} / {_number(mean_vol)} ({found:g} found)"
                if which == "mean"
                else f"{name} {_number(best_eps)}"
            )
        else:
            epsilon, volume = reference.published()[f"paper_{which}"][name][summary.object_id]
            figures.append(f"{name} {_number(epsilon)} / {_number(volume)}")
    return "; ".join(figures)


def _illustrations(illustrations: Illustrations) -> list[str]:
    blocks = []
    for heading, files, text in (
        (
            "Best epsilon over time",
            illustrations.convergence,
            "Mean over seeds; the band is from the worst to the best seed.",
        ),
        (
            "Each planner's best grasp",
            illustrations.pictures,
            "The largest epsilon of all seeds.",
        ),
    ):
        if files:
            images = "\n\n".join(f"![{heading}: {name}]({path})" for name, path in files.items())
            blocks.append(f"## {heading}\n\n{text}\n\n{images}")
    return blocks


def _estimate(estimate: Estimate) -> str:
    if math.isnan(estimate.half_width):
        return _number(estimate.mean)
    return f"{_number(estimate.mean)} ± {_number(estimate.half_width)}"


def _number(value: float) -> str:
    return f"{value:.4f}"


def _times(value: float, to: float) -> str:
    times = ratio(value, to)
    if math.isnan(times):
        return "0 / 0"
    return "∞" if math.isinf(times) else f"{times:.3g}"
