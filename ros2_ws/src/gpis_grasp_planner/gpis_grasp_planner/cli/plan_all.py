"""Plan every part of a directory tree ahead of time, into the grasp store."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gpis_grasp_planner.cli import options, output, tables
from gpis_grasp_planner.cli.exit_codes import ERROR, INTERRUPTED, NO_ANSWER, SUCCESS
from gpis_grasp_planner.cli.interrupt import stop_on_interrupt
from gpis_grasp_planner.grasp.trials import VERIFICATIONS

if TYPE_CHECKING:
    from gpis_grasp_planner.batch.catalogue_work import CatalogueWork
    from gpis_grasp_planner.batch.outcome import Outcome

EXAMPLES = """\
examples:
  gpis-grasp plan-all parts/ --support lowest
  gpis-grasp plan-all parts/ --jobs 8 --time 20 --report report/
  gpis-grasp plan-all parts/ --evaluations 500 --json summary.json
  gpis-grasp plan-all parts/ --scheduler tcp://10.0.0.1:8786
"""
_DEFAULT_TIME_S = 10.0
_LONGEST_TIME_S = 600.0
_ERASE = "\r\x1b[K"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'plan-all'."""
    parser.add_argument(
        "directory", metavar="DIR", type=Path, help="meshes with their YAML files, and folders"
    )
    parser.add_argument(
        "--jobs", type=int, metavar="N", help="parts at a time; default: one for each core"
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="plan on the workers of this Dask scheduler, such as tcp://10.0.0.1:8786",
    )
    parser.add_argument(
        "--time",
        type=float,
        metavar="S",
        help="time budget of each part in seconds; default: 10, with --evaluations 600",
    )
    parser.add_argument(
        "--evaluations",
        type=int,
        metavar="N",
        help="end each search after N attempts, which makes it repeatable to the bit",
    )
    parser.add_argument("--seed", type=int, default=0, help="default: 0")
    parser.add_argument("--grasps", type=int, default=20, metavar="N", help="default: 20")
    parser.add_argument(
        "--support",
        choices=("lowest",),
        help="each part stands on a table, on its lowest point; default: it floats in free space",
    )
    parser.add_argument(
        "--verify", choices=VERIFICATIONS, default="rank", help="as of 'plan'; default: rank"
    )
    parser.add_argument("--planner", default="dual", metavar="NAME", help="default: dual")
    parser.add_argument(
        "--friction",
        type=float,
        metavar="MU",
        help="of fingers and palm; default: each part's YAML file, else 0.6",
    )
    parser.add_argument(
        "--again", action="store_true", help="plan parts anew that had no grasp the last time"
    )
    parser.add_argument(
        "--report", type=Path, metavar="DIR", help="write index.html with a picture of each part"
    )
    parser.add_argument("--no-pictures", action="store_true", help="a report without pictures")
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="write the summary; '-' for stdout, alone"
    )
    options.add_settings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Plan, show, write; 1 where a part could not be read, 3 where one has no grasp."""
    from gpis_grasp_planner.cli import plan_all_report

    output.check_writable(arguments.json)
    if arguments.report is not None and not arguments.no_pictures:
        output.check_drawable()
    jobs = _jobs(arguments)
    if arguments.scheduler is not None:
        output.check_cluster()
    work = _work(arguments)
    mesh_ids, refused = work.catalogue.ids(), work.catalogue.refused()
    if arguments.report is not None:
        arguments.report.mkdir(parents=True, exist_ok=True)
    began = time.monotonic()
    with stop_on_interrupt(_say) as stopped:
        found = _all(work, mesh_ids, jobs, arguments.scheduler, stopped)
        interrupted = stopped()
    spent_s = time.monotonic() - began
    found.sort(key=lambda outcome: outcome.mesh_id)
    left = len(mesh_ids) - len(found)
    to_stdout = str(arguments.json) == "-"
    if arguments.json is not None:
        text = json.dumps(
            {
                "directory": str(arguments.directory),
                "store": str(work.store.database.path),
                "elapsed_s": spent_s,
                "interrupted": interrupted,
                "n_left": left,
                "parts": [outcome.as_mapping() for outcome in found],
                "refused": [{"file": name, "message": why} for name, why in refused],
            },
            indent=1,
        )
        if to_stdout:
            print(text)
        else:
            arguments.json.write_text(text + "\n", encoding="utf-8")
    if not to_stdout:
        _show(found, refused, left, spent_s, work)
    if arguments.report is not None:
        page = arguments.report / "index.html"
        page.write_text(
            plan_all_report.page(found, refused, left, spent_s, _command(arguments)), "utf-8"
        )
        output.note(f"gpis-grasp: report in {page}")
    return _exit_code(found, refused, interrupted)


def _exit_code(
    found: Sequence[Outcome], refused: Sequence[tuple[str, str]], interrupted: bool
) -> int:
    if interrupted:
        output.note("gpis-grasp: interrupted; what was planned is kept, the same command goes on")
        return INTERRUPTED
    if refused or any(not outcome.mesh_hash for outcome in found):
        return ERROR
    return SUCCESS if all(outcome.found for outcome in found) else NO_ANSWER


def _work(arguments: argparse.Namespace) -> CatalogueWork:
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.geometry.catalogue import MeshCatalogue
    from gpis_grasp_planner.geometry.part import Friction
    from gpis_grasp_planner.plan.request import PlanRequest
    from gpis_grasp_planner.store.grasp_store import GraspStore

    settings, catalogue_settings = options.read_settings(arguments.settings, arguments.assignments)
    catalogue = MeshCatalogue([arguments.directory], catalogue_settings)
    by_evaluations = arguments.evaluations is not None
    longest = _LONGEST_TIME_S if by_evaluations else _DEFAULT_TIME_S
    mu = arguments.friction
    request = PlanRequest(
        planner=arguments.planner,
        seed=arguments.seed,
        time_budget_s=longest if arguments.time is None else arguments.time,
        n_grasps=arguments.grasps,
        friction=None if mu is None else Friction(mu, mu),
        max_evaluations=arguments.evaluations,
        verification=arguments.verify,
    )
    store = GraspStore.of(settings.store)
    if store is None:
        raise RequestError(
            "The grasp store is switched off (store.enabled, GPIS_GRASP_STORE), and plan-all keeps "
            "its plans there. Name a file with --set store.path=FILE."
        )
    with store.database.reading():  # before the work: a store that cannot be read raises here
        pass
    from gpis_grasp_planner.batch.catalogue_work import CatalogueWork
    from gpis_grasp_planner.batch.part_planning import PartPlanning
    from gpis_grasp_planner.cli.drawing import best_grasp_drawer
    from gpis_grasp_planner.cli.preparation import ready_to_plan
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.plan.warm_up import load_compiled

    if arguments.scheduler is None:
        ready_to_plan(request.planner)
        load_compiled()  # the children inherit it
    drawn = arguments.report is not None and not arguments.no_pictures
    return CatalogueWork(
        PartPlanning(settings, request, on_lowest=arguments.support == "lowest"),
        GraspPlanner(settings),
        store,
        catalogue,
        again=arguments.again,
        draw=best_grasp_drawer(arguments.report / "pictures") if drawn else None,
    )


def _jobs(arguments: argparse.Namespace) -> int:
    from gpis_grasp_planner.errors import RequestError
    from gpis_grasp_planner.forked_child import jobs_asked_for

    if arguments.jobs is not None and arguments.scheduler is not None:
        raise RequestError(
            "--jobs is for this machine; with --scheduler each worker has its own "
            "('gpis-grasp worker ADDRESS --jobs N'). Give one of the two."
        )
    return jobs_asked_for(arguments.jobs)


def _all(
    work: CatalogueWork,
    mesh_ids: Sequence[str],
    jobs: int,
    scheduler: str | None,
    stopped: Callable[[], bool],
) -> list[Outcome]:
    from gpis_grasp_planner.batch.local_jobs import outcomes_here

    found: list[Outcome] = []
    began = time.monotonic()
    live = sys.stderr.isatty() and os.environ.get("TERM") != "dumb"

    def show(running: Sequence[str]) -> None:
        if live:
            width = shutil.get_terminal_size().columns - 1
            line = progress_text(found, len(mesh_ids), time.monotonic() - began, running)
            _write(_ERASE + line[:width])

    def take(outcomes: Iterable[Outcome]) -> None:
        for outcome in outcomes:
            found.append(outcome)
            show([])

    if scheduler is None:
        take(outcomes_here(work, mesh_ids, jobs, stopped, show))
    else:
        from gpis_grasp_planner.batch.cluster import Cluster

        # Pictures are drawn where the report is, of what is kept by then.
        with Cluster(replace(work, draw=None), scheduler) as cluster:
            take(cluster.outcomes(mesh_ids, stopped, show))
        if work.draw is not None:
            drawn = [outcome.mesh_id for outcome in found if outcome.kept]
            pictures = {
                o.mesh_id: o.picture for o in outcomes_here(work, drawn, jobs, stopped, show)
            }
            found = [replace(o, picture=pictures.get(o.mesh_id, "")) for o in found]
    if live:
        _write(_ERASE)
    return found


def progress_text(
    found: Sequence[Outcome], n: int, elapsed_s: float, running: Sequence[str]
) -> str:
    """One line: how many of how many, and by the parts planned in this run rate and time left."""
    filled = round(10 * len(found) / max(n, 1))
    text = f"[{'#' * filled}{'.' * (10 - filled)}] {len(found)}/{n}"
    planned = sum(outcome.planned for outcome in found)
    if planned:
        rate = planned / elapsed_s
        text += f", {60.0 * rate:.1f} a minute, {_duration((n - len(found)) / rate)} left"
    without = sum(not outcome.found for outcome in found)
    if without:
        text += f", {without} without grasp"
    return text + (f": {', '.join(running)}" if running else "")


def _duration(seconds: float) -> str:
    if seconds < 60.0:
        return f"{seconds:.0f} s"
    if seconds < 5400.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"


def _show(
    found: Sequence[Outcome],
    refused: Sequence[tuple[str, str]],
    left: int,
    spent_s: float,
    work: CatalogueWork,
) -> None:
    if found:
        tables.print_table(_columns(found))
        print()
    for outcome in found:
        if not outcome.found:
            tables.print_text(f"{outcome.mesh_id}: {outcome.code}: {outcome.message}")
        elif not outcome.kept:
            tables.print_text(f"{outcome.mesh_id}: its plan is not kept.")
    for name, why in refused:
        tables.print_text(f"{ascii(name)[1:-1]} cannot be planned: {why}.")
    counts = Counter(outcome.code for outcome in found)
    planned = sum(outcome.planned for outcome in found)
    kept = sum(outcome.from_store for outcome in found)
    tables.print_text(
        f"{len(found)} parts ({', '.join(f'{code} {n}' for code, n in counts.most_common())}) in "
        f"{_duration(spent_s)}; {planned} planned now, {kept} kept from before"
        + (f", {left} left" if left else "")
        + f". Plans are in {work.store.database.path}"
        if found
        else "No part was planned."
    )


def _columns(found: Sequence[Outcome]) -> list[tables.Column]:
    epsilons = ["" if o.best_epsilon is None else f"{o.best_epsilon:.4f}" for o in found]
    return [
        tables.Column("mesh ID", [o.mesh_id for o in found], 0, left=True),
        tables.Column("grasps", [str(o.n_grasps) for o in found], 0),
        tables.Column("epsilon", epsilons, 0),
        tables.Column("held", [f"{o.n_held}/{o.n_tried}" for o in found], 1),
        tables.Column("s", [f"{o.elapsed_s:.1f}" for o in found], 2),
        tables.Column(
            "plan",
            ["kept" if o.from_store else "new" if o.planned else "" for o in found],
            3,
            left=True,
        ),
        tables.Column("state", [o.code for o in found], 0, left=True),
    ]


def _command(arguments: argparse.Namespace) -> str:
    import shlex

    return shlex.join(["gpis-grasp", *arguments.words])


def _say(message: str) -> None:
    _write(_ERASE if sys.stderr.isatty() else "")
    _write(
        message.replace("stopping with what was found", "stopping; what is planned is kept") + "\n"
    )


def _write(text: str) -> None:
    os.write(sys.stderr.fileno(), text.encode())
