"""The report of a success study as Markdown: shares, failures by cause, penetration, cost."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from gpis_grasp_benchmark.bullet_objects import Refusal
from gpis_grasp_benchmark.markdown import table
from gpis_grasp_benchmark.runs import Record
from gpis_grasp_benchmark.shares import MeanInterval, Share
from gpis_grasp_benchmark.strict_tests import NOISE, NOMINAL, TESTS
from gpis_grasp_benchmark.study_outcomes import (
    NOT_PLANNABLE,
    REFUSED,
    Outcome,
    outcomes,
)

TOTAL = "all"
_MADE_S = 0.01

DEFINITIONS = """\
An object passes a test if the **first** grasp that the planner answered passes all six directions
(15 m/s^2 for 2 s each, from a fresh state; less than 3 cm and 15 degrees; penetration at most
1 mm; links of two fingers, or of a finger and the palm, pressing). The trials are made after and
apart from planning, with displacements that the planner has not seen.

- *nominal*: friction {friction:g}, {mass_kg:g} kg.
- *slippery*: friction {low_friction:g}, {mass_kg:g} kg.
- *slippery, CAD mass*: friction {low_friction:g} and the volume at 1000 kg/m^3, or {mass_kg:g} kg
  where that is {payload_kg:g} kg or more. The volume of bodies that overlap counts the overlap
  twice.
- *pose noise*: nominal on a part that lies {noise_m:g} mm and {noise_deg:g} degrees from where it
  was thought, in {noise_repeats} seeded directions; passes if more than half of them are held.
- *table lift*: nominal, {lift_m:g} m up against the approach, then a shake of {shake_m:g} cm along
  three axes.

**Graspable** is an object of which some tried grasp passes the nominal test: {tried} of the
answer or, where none of them does, as many of `{second}` with the same budget. **All** counts
refused meshes and objects without a grasp as failures. Intervals are 95 %: Wilson's for shares of
objects, the bootstrap over objects for means."""


def study_report(
    records: Sequence[Record], refused: Sequence[Refusal], command: str, missing: Sequence[str] = ()
) -> str:
    """Write the whole report.

    Parameters
    ----------
    records : sequence of dict
        Of study runs with the same settings.
    refused : sequence of Refusal
    command : str
    missing : sequence of str
        Objects whose run did not end; they are in no share.
    """
    found = outcomes(records, refused)
    blocks = [
        "# Success study: the strict protocol",
        made_by(records, command),
        "## What is tried\n\n" + _definitions(records[0]),
        "## Objects whose first grasp passes, of those that are graspable\n\n"
        + _shares(found, lambda o: o.graspable),
        "## Of all objects\n\n" + _shares(found, lambda _: True),
        "## Failures by cause\n\n" + _failures(found),
        _failed_first(records, found),
        _without_grasp(found),
        "## Penetration\n\n" + _penetration(records),
        "## What the planner said\n\n" + _said(records),
        "## Cost\n\n" + _cost(records),
        "## Objects\n\n" + _objects(records, found),
    ]
    if missing:
        names = ", ".join(missing)
        blocks.insert(2, f"**Not finished, and in none of the shares**: {names}.")
    return "\n\n".join(block for block in blocks if block) + "\n"


def made_by(records: Sequence[Record], command: str) -> str:
    """The command, sizes, versions and machine behind the records."""

    def all_of(values: Iterable[object]) -> str:
        return ", ".join(dict.fromkeys(str(value) for value in values))

    environments = [record["environment"] for record in records]
    sources = dict.fromkeys(e["source"] for e in environments)
    lines = [
        f"    {command}",
        "",
        f"- {len(records)} objects were planned on by {all_of(r['planner'] for r in records)}, "
        f"seed {all_of(r['seed'] for r in records)}, "
        f"{all_of(r['time_budget_s'] or 'unlimited' for r in records)} s, one process each "
        "and its children, where the planner tries grasps.",
        f"- Version {all_of(r['version'] for r in records)}, sources {', '.join(sources)}, "
        f"settings {all_of(r['settings_hash'] for r in records)} (in full in `results.json`).",
        "- "
        + "; ".join(
            f"{name} {all_of(e[name] for e in environments)}"
            for name in ("cpu", "python", "numpy", "scipy", "numba")
        )
        + ".",
    ]
    if len(sources) > 1:
        lines.append(f"- **These runs come from {len(sources)} states of the sources.**")
    return "\n".join(lines)


def _definitions(record: Record) -> str:
    v = record["settings"]["verification"]
    return DEFINITIONS.format(
        **{name: v[name] for name in ("friction", "low_friction", "mass_kg", "payload_kg")},
        noise_m=1e3 * v["noise_m"],
        noise_deg=v["noise_deg"],
        noise_repeats=record["displacements"],
        lift_m=v["lift_m"],
        shake_m=1e2 * v["shake_m"],
        tried=record["tried"],
        second=record["second_planner"],
    )


def _shares(found: Sequence[Outcome], counts: Callable[[Outcome], bool]) -> str:
    heads = ["objects", "n", *TESTS, f"{NOISE}: displacements held"]
    rows = []
    for name in (*dict.fromkeys(o.object_set for o in found), TOTAL):
        members = [o for o in found if name in (o.object_set, TOTAL) and counts(o)]
        shares = [Share.of([o.verdicts[test].held for o in members]) for test in TESTS]
        mean = MeanInterval.of([o.verdicts[NOISE].share for o in members])
        cells = [share_text(share) for share in shares]
        cells.append(percent(mean.mean, mean.low, mean.high) if mean.n else "")
        rows.append([name, str(len(members)), *cells])
    return table(heads, rows)


def _failures(found: Sequence[Outcome]) -> str:
    heads = ["test", "cause", "n", "objects"]
    rows = []
    for test in TESTS:
        by_cause: dict[str, list[str]] = {}
        for outcome in found:
            verdict = outcome.verdicts[test]
            # Without any grasp it fails every test alike: said once.
            said = verdict.cause in (REFUSED, NOT_PLANNABLE) and test != NOMINAL
            if not verdict.held and not said:
                by_cause.setdefault(verdict.cause, []).append(_named(outcome))
        rows += [
            [test, cause, str(len(names)), ", ".join(names)]
            for cause, names in sorted(by_cause.items(), key=lambda item: -len(item[1]))
        ]
    if not rows:
        return "None."
    text = "Objects in italics are not graspable by any grasp that was tried.\n\n"
    return text + table(heads, rows)


def _named(outcome: Outcome) -> str:
    return outcome.object_id if outcome.graspable else f"*{outcome.object_id}*"


def _failed_first(records: Sequence[Record], found: Sequence[Outcome]) -> str:
    """What is known of each first grasp that fails the nominal test."""
    heads = ["object", "cause", "epsilon", "pressing after closing", "moved while closing",
             "moved when pushed", "the planner said", "of the answer hold",
             "of the second planner's"]  # fmt: skip
    rows = []
    for record, outcome in zip(records, found, strict=False):
        nominal = [row for row in record["trials"] if row["test"] == NOMINAL]
        own = [row for row in nominal if row["planner"] == record["planner"]]
        if not own or own[0]["held"]:
            continue
        other = [row for row in nominal if row["planner"] != record["planner"]]
        plan, first = record["plans"][0], own[0]
        said = {True: "holds", False: "fails", None: "not tried"}[plan["said_to_hold"][0]]
        rows.append(
            [
                _named(outcome),
                first["cause"],
                f"{plan['epsilon'][0]:.3f}",
                _links(first["touching"]),
                f"{first['closing_slip_mm']:.1f} mm, {first['closing_turn_deg']:.0f} deg",
                f"{first['slip_mm']:.1f} mm, {first['turn_deg']:.0f} deg",
                said,
                f"{sum(row['held'] for row in own)} of {len(own)}",
                f"{sum(row['held'] for row in other)} of {len(other)}" if other else "",
            ]
        )  # fmt: skip
    if not rows:
        return ""
    return "## First grasps that fail the nominal test\n\n" + table(heads, rows)


def _links(names: Sequence[str]) -> str:
    short = (name.removeprefix("bh_").removesuffix("_link").replace("_", " ") for name in names)
    return ", ".join(short) or "nothing"


def _without_grasp(found: Sequence[Outcome]) -> str:
    rows = [[o.object_id, o.object_set, o.message] for o in found if o.message]
    if not rows:
        return ""
    return "## Refused, or without a grasp\n\n" + table(["object", "set", "why"], rows)


def _penetration(records: Sequence[Record]) -> str:
    rows = [
        (row["penetration_mm"], row["cause"], record["object_id"])
        for record in records
        for row in record["trials"]
        if row["test"] == NOMINAL and row["rank"] == 0 and row["planner"] == record["planner"]
    ]
    if not rows:
        return "No grasp was tried."
    deepest = max(rows)
    held = [row for row in rows if not row[1]]
    text = f"Largest of the first grasps, planned or closed: {deepest[0]:.2f} mm ({deepest[2]})"
    if held:
        text += f"; of those that pass: {max(held)[0]:.2f} mm ({max(held)[2]})"
    return f"{text}. {sum(row[0] > 1.0 for row in rows)} of {len(rows)} are deeper than 1 mm."


def _said(records: Sequence[Record]) -> str:
    pairs = [
        (plan["said_to_hold"][row["rank"]], row["held"])
        for record in records
        for plan in record["plans"]
        for row in record["trials"]
        if row["test"] == NOMINAL and row["planner"] == plan["planner"]
    ]
    tried = [(said, held) for said, held in pairs if said is not None]
    if not tried:
        return "The planner tried none of its grasps: they are ranked by epsilon and volume."
    agree = Share.of([said == held for said, held in tried])
    return (
        f"Of {len(pairs)} grasps in the nominal test the planner had tried {len(tried)} itself; "
        f"the verdicts agree on {share_text(agree)}."
    )


def _cost(records: Sequence[Record]) -> str:
    rows = []
    for test in TESTS:
        times = [row["elapsed_s"] for r in records for row in r["trials"] if row["test"] == test]
        if times:
            rows.append([test, str(len(times)), *_seconds(times)])
    covers = [r["cover_s"] for r in records if r["cover_s"] > _MADE_S]
    for what, values in (
        ("planning", [r["plans"][0]["elapsed_s"] for r in records]),
        ("convex cover, where planning had not made it", covers),
    ):
        if values:
            rows.append([what, str(len(values)), *_seconds(values)])
    return "Seconds of one core; " + (
        "a trial is all six directions, or one lift.\n\n"
        + table(["", "n", "mean", "median", "95th percentile", "sum"], rows)
    )


def _seconds(times: Sequence[float]) -> list[str]:
    figures = (np.mean(times), np.median(times), np.percentile(times, 95), np.sum(times))
    return [f"{figure:.2f}" for figure in figures]


def _objects(records: Sequence[Record], found: Sequence[Outcome]) -> str:
    heads = ["object", "set", "extent [mm]", "faces", "planning [s]", "evaluations", "epsilon",
             "penetration [mm]", "slip [mm]", "turn [deg]", *TESTS]  # fmt: skip
    rows = []
    for record, outcome in zip(records, found, strict=False):  # the refused ones have no record
        plan = record["plans"][0]
        first = next((row for row in record["trials"] if row["rank"] == 0), None)
        if first is None or first["planner"] != plan["planner"]:
            motion = ["", "", ""]
        else:
            motion = [f"{first[k]:.2f}" for k in ("penetration_mm", "slip_mm", "turn_deg")]
        rows.append(
            [
                record["object_id"],
                record["object_set"],
                " x ".join(f"{1e3 * side:.0f}" for side in record["extent_m"]),
                str(record["faces"]),
                f"{plan['elapsed_s']:.1f}",
                str(plan["evaluations"]),
                f"{plan['epsilon'][0]:.3f}" if plan["epsilon"] else "",
                *motion,
                *(_cell(outcome, test) for test in TESTS),
            ]
        )
    return table(heads, rows)


def _cell(outcome: Outcome, test: str) -> str:
    verdict = outcome.verdicts[test]
    if test == NOISE:
        share = f"{100 * verdict.share:.0f} %"
        return share if verdict.held else f"{share}, {verdict.cause}"
    return "yes" if verdict.held else verdict.cause


def share_text(share: Share) -> str:
    """A share of objects with its interval."""
    if not share.n:
        return ""
    return f"{share.passed}/{share.n} = {percent(share.value, *share.interval)}"


def percent(value: float, low: float, high: float) -> str:
    """A value with its interval in percent."""
    return f"{100 * value:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"
