"""The command ``gpis-grasp-benchmark``: planners compared on many objects, or tried in physics."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from gpis_grasp_benchmark import success_study
from gpis_grasp_benchmark.reference import ORIGINAL, facts_of
from gpis_grasp_planner.cli import options, tables
from gpis_grasp_planner.cli.exit_codes import ERROR, SUCCESS
from gpis_grasp_planner.cli.main import run_command
from gpis_grasp_planner.cli.parser import CommandParser, add_common

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gpis_grasp_benchmark.runs import Run
    from gpis_grasp_benchmark.store import RunStore
    from gpis_grasp_benchmark.tables import Summary
    from gpis_grasp_planner.geometry.part import Part

QUALITY = "quality"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the benchmark."""
    parser.add_argument("mesh", metavar="MESH", nargs="*", help="IDs; default: the whole catalogue")
    parser.add_argument(
        "--objects",
        "--meshes",
        dest="meshes",
        metavar="DIR",
        action="append",
        type=Path,
        help="directory of meshes, repeatable; default: the shipped parts",
    )
    parser.add_argument(
        "--facts",
        metavar="FILE.yaml",
        help="mass, centre of mass and friction by mesh ID, where no YAML file lies beside the "
        f"mesh; '{ORIGINAL}': those of the original simulator's five objects",
    )
    parser.add_argument(
        "--planners", metavar="A,B", default="dual", help="names, or 'all'; default: dual"
    )
    parser.add_argument("--seeds", type=int, default=5, metavar="N", help="seeds 0 to N-1; 5")
    parser.add_argument("--time", type=float, default=20.0, metavar="S", help="per run; 20")
    parser.add_argument(
        "--evaluations", type=int, metavar="N", help="equal evaluations instead of equal time"
    )
    parser.add_argument(
        "--friction",
        type=float,
        nargs=2,
        metavar=("FINGER", "PALM"),
        help="for all objects; default: the object's, else 0.6",
    )
    parser.add_argument("--grasps", type=int, default=20, metavar="N", help="grasps per run; 20")
    parser.add_argument("--cores", type=int, default=1, metavar="N", help="runs at a time; 1")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/benchmark"),
        metavar="DIR",
        help="results; what is finished there is not made again (out/benchmark)",
    )
    parser.add_argument(
        "--protocol",
        choices=(QUALITY, *success_study.PROTOCOLS),
        default=QUALITY,
        help="quality: epsilon and volume; strict: whether the first grasp holds in physics; "
        "ranking: which order of the grasps stands a displaced part (quality)",
    )
    success_study.add_arguments(parser)
    parser.add_argument("--no-pictures", action="store_true", help="plots only, no pictures")
    options.add_settings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Make the missing runs, then write the results of all."""
    if arguments.protocol != QUALITY:
        return success_study.run(arguments)
    from gpis_grasp_benchmark.execution import run_all
    from gpis_grasp_benchmark.store import RunStore
    from gpis_grasp_planner.cli import output

    parts, runs = _plan_of_work(arguments)
    store = RunStore(arguments.out)
    done = sum(store.has(r) for r in runs)
    if done:
        output.note(f"{done} of {len(runs)} runs are in {arguments.out} already")
    try:
        with output.count_progress("benchmark", len(runs) - done) as show:
            faults = run_all(runs, parts, store, arguments.cores, lambda made, _: show(made.name))
    except KeyboardInterrupt:
        output.note(f"stopped; the same command goes on with what {arguments.out} lacks")
        raise
    for fault in faults:
        output.note(f"gpis-grasp-benchmark: error: {fault}")
    _write(arguments, store, runs, parts)
    return ERROR if faults else SUCCESS


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    made = CommandParser(
        prog="gpis-grasp-benchmark",
        description="Compare planners on many objects, or try their grasps in physics; write a "
        "report.",
    )
    add_arguments(made)
    add_common(made)
    made.set_defaults(run=run)
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code is the return value."""
    return run_command(parser(), argv)


def _plan_of_work(arguments: argparse.Namespace) -> tuple[dict[str, Part], list[Run]]:
    from gpis_grasp_benchmark import objects
    from gpis_grasp_benchmark.runs import Run, object_hash
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.geometry.part import Friction
    from gpis_grasp_planner.plan.request import DEFAULT_FRICTION
    from gpis_grasp_planner.search.searches import check_planner, planner_names

    for name in ("seeds", "cores"):
        if getattr(arguments, name) < 1:
            raise RequestError(f"--{name} is {getattr(arguments, name)}; give at least 1.")
    settings, catalogue_settings = options.read_settings(arguments.settings, arguments.assignments)
    facts = facts_of(arguments.facts)
    catalogue = options.catalogue_of(arguments.meshes, catalogue_settings)
    parts = objects.load_objects(catalogue, arguments.mesh, facts)
    planners = (
        list(planner_names()) if arguments.planners == "all" else arguments.planners.split(",")
    )
    asked = Friction(*arguments.friction) if arguments.friction else None
    runs = [
        Run(
            object_id=mesh_id,
            object_hash=object_hash(part),
            planner=check_planner(planner.strip()),
            seed=seed,
            time_budget_s=arguments.time,
            max_evaluations=arguments.evaluations,
            n_grasps=arguments.grasps,
            friction=asked or part.friction or DEFAULT_FRICTION,
            settings=settings.as_dict(),
        )
        for mesh_id, part in parts.items()
        for planner in planners
        for seed in range(arguments.seeds)
    ]
    for one in runs:
        one.request()  # refuses what is out of range before the first run, not in it
    return parts, runs


def _write(
    arguments: argparse.Namespace, store: RunStore, runs: list[Run], parts: dict[str, Part]
) -> None:
    from gpis_grasp_benchmark.illustrations import illustrate
    from gpis_grasp_benchmark.report import report
    from gpis_grasp_benchmark.tables import summarise

    records = store.select(runs)
    if not records:
        return
    store.write_results(records)
    pictures = illustrate(store, records, parts, pictures=not arguments.no_pictures)
    command = "gpis-grasp-benchmark " + shlex.join(arguments.words)
    path = arguments.out / "report.md"
    path.write_text(report(records, command, pictures), encoding="utf-8")
    tables.print_table(_summary_columns(summarise(records)))
    print(f"report: {path}")


def _summary_columns(summaries: Sequence[Summary]) -> list[tables.Column]:
    """One row per object and planner."""
    columns = [
        ("object", [s.object_id for s in summaries], 0),
        ("planner", [s.planner for s in summaries], 0),
        ("best epsilon", [f"{s.best_epsilon.mean:.4f}" for s in summaries], 3),
        ("its volume", [f"{s.best_volume.mean:.4f}" for s in summaries], 4),
        ("mean epsilon", [f"{s.mean_epsilon.mean:.4f}" for s in summaries], 0),
        ("mean volume", [f"{s.mean_volume.mean:.4f}" for s in summaries], 1),
        ("grasps", [f"{s.found.mean:.1f}" for s in summaries], 5),
        ("evaluations/s", [f"{s.evaluations_per_s.mean:.0f}" for s in summaries], 2),
    ]
    return [
        tables.Column(heading, cells, priority, left=heading in ("object", "planner"))
        for heading, cells, priority in columns
    ]


if __name__ == "__main__":
    sys.exit(main())
