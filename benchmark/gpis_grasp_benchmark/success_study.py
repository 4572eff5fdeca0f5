"""The success studies of ``gpis-grasp-benchmark``: what is planned is tried in physics."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gpis_grasp_benchmark.reference import facts_of
from gpis_grasp_planner.cli import options
from gpis_grasp_planner.cli.exit_codes import ERROR, SUCCESS

if TYPE_CHECKING:
    from gpis_grasp_benchmark.ranking_runs import RankingRun
    from gpis_grasp_benchmark.runs import Run
    from gpis_grasp_benchmark.store import RunStore
    from gpis_grasp_benchmark.study_objects import StudyObjects
    from gpis_grasp_benchmark.study_runs import StudyRun
STRICT, RANKING = "strict", "ranking"
PROTOCOLS = (STRICT, RANKING)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the studies."""
    group = parser.add_argument_group(
        "studies in physics",
        "--objects may be 'shipped'; one seed; --grasps are those of the answer",
    )
    group.add_argument(
        "--bullet-objects",
        type=int,
        metavar="N",
        help="N random parts of PyBullet's data package and all of its household objects",
    )
    group.add_argument("--seed", type=int, default=0, metavar="N", help="planning and sizes; 0")
    group.add_argument("--tried", type=int, default=5, metavar="N", help="grasps per answer; 5")
    group.add_argument(
        "--displacements",
        type=int,
        default=10,
        metavar="N",
        help="strict: of the first grasp under pose noise; ranking: of every grasp tried; 10",
    )
    group.add_argument(
        "--selecting",
        type=int,
        default=5,
        metavar="N",
        help="ranking: further displacements, by which trials order the grasps; 5",
    )
    group.add_argument(
        "--noise-seed", type=int, default=20_000, metavar="N", help="of the displacements; 20000"
    )


def run(arguments: argparse.Namespace) -> int:
    """Make the missing runs, then write the results of all."""
    from gpis_grasp_benchmark.execution import run_all
    from gpis_grasp_benchmark.store import RunStore
    from gpis_grasp_planner.cli import output

    objects, runs = _plan_of_work(arguments)
    store = RunStore(arguments.out)
    done = sum(store.has(r) for r in runs)
    if done:
        output.note(f"{done} of {len(runs)} objects are in {arguments.out} already")
    try:
        with output.count_progress("study", len(runs) - done) as show:
            faults = run_all(
                runs, objects.parts, store, arguments.cores, lambda made, _: show(made.name)
            )
    except KeyboardInterrupt:
        output.note(f"stopped; the same command goes on with what {arguments.out} lacks")
        raise
    for fault in faults:
        output.note(f"gpis-grasp-benchmark: error: {fault}")
    _write(arguments, objects, store, runs)
    return ERROR if faults else SUCCESS


def shown_command(words: Sequence[str]) -> str:
    """The command as a report shows it: a path is a name, since directories are the machine's."""
    return "gpis-grasp-benchmark " + shlex.join(
        Path(w).name if w.startswith("/") else w for w in words
    )


def _plan_of_work(
    arguments: argparse.Namespace,
) -> tuple[StudyObjects, list[StudyRun | RankingRun]]:
    from gpis_grasp_benchmark.runs import Run, object_hash
    from gpis_grasp_benchmark.study_objects import SHIPPED, collect
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.geometry.part import Friction
    from gpis_grasp_planner.plan.request import DEFAULT_FRICTION
    from gpis_grasp_planner.search.searches import check_planner

    for name in ("cores", "tried", "displacements", "selecting"):
        if getattr(arguments, name) < 1:
            raise RequestError(f"--{name} is {getattr(arguments, name)}; give at least 1.")
    if arguments.noise_seed < 0 or arguments.noise_seed == arguments.seed:
        raise RequestError(
            f"--noise-seed is {arguments.noise_seed}; give at least 0, and not --seed: the planner "
            "draws its own displacements from that."
        )
    settings, catalogue_settings = options.read_settings(arguments.settings, arguments.assignments)
    asked = Friction(*arguments.friction) if arguments.friction else None
    objects = collect(
        arguments.meshes or [Path(SHIPPED)],
        arguments.mesh,
        facts_of(arguments.facts),
        arguments.bullet_objects,
        arguments.seed,
        catalogue_settings,
    )
    runs = [
        _with_trials(
            arguments,
            Run(
                object_id=object_id,
                object_hash=object_hash(part),
                planner=check_planner(arguments.planners),
                seed=arguments.seed,
                time_budget_s=arguments.time,
                max_evaluations=arguments.evaluations,
                n_grasps=arguments.grasps,
                friction=asked or part.friction or DEFAULT_FRICTION,
                settings=settings.as_dict(),
            ),
            objects.set_of[object_id],
        )
        for object_id, part in objects.parts.items()
    ]
    for one in runs:
        one.plan.request()  # refuses what is out of range before the first run, not in it
    return objects, runs


def _with_trials(
    arguments: argparse.Namespace, plan: Run, object_set: str
) -> StudyRun | RankingRun:
    from gpis_grasp_benchmark.ranking_runs import RankingRun
    from gpis_grasp_benchmark.study_runs import StudyRun

    if arguments.protocol == RANKING:
        return RankingRun(
            plan=plan,
            object_set=object_set,
            tried=arguments.tried,
            displacements=arguments.displacements,
            selecting=arguments.selecting,
            noise_seed=arguments.noise_seed,
        )
    return StudyRun(
        plan=plan,
        object_set=object_set,
        tried=arguments.tried,
        displacements=arguments.displacements,
        noise_seed=arguments.noise_seed,
    )


def _write(
    arguments: argparse.Namespace,
    objects: StudyObjects,
    store: RunStore,
    runs: Sequence[StudyRun | RankingRun],
) -> None:
    from gpis_grasp_benchmark.ranking_report import ranking_report, write_ranking_tables
    from gpis_grasp_benchmark.study_outcomes import write_tables
    from gpis_grasp_benchmark.study_report import study_report

    records = store.select(runs)
    if not records:
        return
    missing = [one.object_id for one in runs if not store.has(one)]
    command = shown_command(arguments.words)
    if arguments.protocol == RANKING:
        write_ranking_tables(arguments.out, records)
        text = ranking_report(records, command, missing)
    else:
        write_tables(arguments.out, records, objects.refused)
        text = study_report(records, objects.refused, command, missing)
    path = arguments.out / "report.md"
    path.write_text(text, encoding="utf-8")
    print(f"report: {path}")
