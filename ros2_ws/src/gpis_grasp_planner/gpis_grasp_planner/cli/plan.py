"""Plan grasps of a part: a table, a JSON document, a picture."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from gpis_grasp_planner.cli import (
    completion,
    constraint_options,
    explain,
    options,
    output,
    place_options,
    tables,
)
from gpis_grasp_planner.cli.exit_codes import INTERRUPTED, NO_ANSWER, SUCCESS
from gpis_grasp_planner.cli.interrupt import stop_on_interrupt
from gpis_grasp_planner.cli.status_line import StatusLine
from gpis_grasp_planner.grasp.trials import VERIFICATIONS

if TYPE_CHECKING:
    from collections.abc import Callable

    from gpis_grasp_planner.geometry.part import Part
    from gpis_grasp_planner.plan.document import MeshSource
    from gpis_grasp_planner.plan.request import PlanResult

# The names of search.searches.PLANNERS, which loads the planner; other distributions have more.
PLANNERS = (
    "dual",
    "hpp",
    "paper",
    "random",
    "random-adaption",
)
EXAMPLES = """\
examples:
  gpis-grasp plan mug
  gpis-grasp plan ./part.stl --unit mm --json grasps.json --picture best.png
  gpis-grasp plan mug --support lowest --sigma-mm 5 --time 10
  gpis-grasp plan mug --seed 7 --evaluations 500 --verify none
  gpis-grasp plan mug --support lowest --explain
  gpis-grasp plan mug --set verification.mass_kg=0.3
  gpis-grasp plan flange --hand parallel_jaw
  gpis-grasp plan mug --objective least_friction --explain
  gpis-grasp plan bracket --task "insert 0 0 -1 at 0 0 -0.03"
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'plan'."""
    mesh = parser.add_argument("mesh", metavar="MESH", help="catalogue ID, or path to a mesh file")
    mesh.completer = completion.mesh_ids  # type: ignore[attr-defined]
    parser.add_argument("--seed", type=int, default=0, help="default: 0")
    parser.add_argument(
        "--time", type=float, default=5.0, metavar="S", help="time budget in seconds; default: 5"
    )
    parser.add_argument(
        "--evaluations",
        type=int,
        metavar="N",
        help="end the search after N attempts, which makes it repeatable to the bit where "
        "--time does not end it first",
    )
    parser.add_argument(
        "--friction",
        type=float,
        metavar="MU",
        help="of fingers and palm on the part; default: the part's YAML file, else 0.6",
    )
    parser.add_argument("--friction-palm", type=float, metavar="MU", help="of the palm alone")
    parser.add_argument(
        "--verify",
        choices=VERIFICATIONS,
        default="rank",
        help="try grasps in physics, beside the search and in the last fifth of the time: those "
        "that hold come first (rank, the default), or are all that is answered (require)",
    )
    parser.add_argument(
        "--planner",
        default="dual",
        metavar="NAME",
        help=f"{', '.join(PLANNERS)}, or one of an installed distribution such as "
        "gpis-grasp-benchmark; default: dual",
    )
    options.add_hand(parser)
    options.add_objective(parser)
    options.add_arm(parser)
    parser.add_argument("--grasps", type=int, default=20, metavar="N", help="default: 20")
    options.add_mesh_file(parser)
    parser.add_argument(
        "--store",
        action="store_true",
        help="answer from the grasp store where it knows enough, and keep what is planned there",
    )
    options.add_catalogue(parser)
    options.add_settings(parser)
    place_options.add_place(parser)
    constraint_options.add_constraints(parser)
    constraint_options.add_own(parser)
    parser.add_argument(
        "--explain",
        action="store_true",
        help="show where grasps got lost, step by step, and what can be done about it",
    )
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="write the document; '-' for stdout, alone"
    )
    parser.add_argument(
        "--picture",
        type=Path,
        metavar="FILE.png",
        help="draw the best grasp; with --explain also where hands were lost",
    )


def run(arguments: argparse.Namespace) -> int:
    """Plan, print, write; 3 where there is no grasp, 130 after Ctrl-C."""
    output.check_writable(arguments.json)
    output.check_picture(arguments.picture)
    with StatusLine("loading") as status, stop_on_interrupt(status.note) as stopped:
        part, source, result, placed = _plan(arguments, status, stopped)
        interrupted = stopped()
    to_stdout = arguments.json is not None and str(arguments.json) == "-"
    if arguments.json is not None:
        from gpis_grasp_planner.plan.document import document_text

        text = document_text(result, source)
        if to_stdout:
            sys.stdout.write(text)
        else:
            arguments.json.write_text(text, encoding="utf-8")
    if not to_stdout and result.grasps:
        _show(result)
        if placed:
            tables.print_text(result.message)
    if arguments.explain and not to_stdout:
        explain.show(result.funnel)
        explain.show_figures(result)
    for text in (*result.notes, *_short_of_time(result)):
        output.note(f"note: {text}")
    if arguments.picture is not None:
        with StatusLine("drawing"):
            _draw(arguments, part, result)
    if interrupted:
        n = len(result.grasps)
        found = (
            "no grasp was found"
            if n == 0
            else "1 grasp was found"
            if n == 1
            else (f"{n} grasps were found")
        )
        output.note(f"gpis-grasp: CANCELLED: interrupted; {found} until then.")
        return INTERRUPTED
    if not result.success:
        output.note(f"gpis-grasp: {result.code.name}: {result.message}")
        return NO_ANSWER
    return SUCCESS


def _plan(
    arguments: argparse.Namespace, status: StatusLine, stopped: Callable[[], bool]
) -> tuple[Part, MeshSource | None, PlanResult, bool]:
    """The part, its file, the answer, and whether a place was given."""
    from gpis_grasp_planner.plan.request import PlanRequest

    assignments = options.with_hand(arguments.assignments, arguments.hand)
    assignments = options.with_arm(assignments, arguments.arm)
    assignments = options.with_objective(assignments, arguments.objective, arguments.task)
    assignments = constraint_options.with_own(assignments, arguments.constraint_names)
    settings, catalogue_settings = options.read_settings(arguments.settings, assignments)
    catalogue = options.catalogue_of(arguments.meshes, catalogue_settings)
    from gpis_grasp_planner.cli.preparation import ready_to_plan, timed_reading

    status.enter("reading")
    read = options.reader_of(arguments.mesh, arguments.unit, catalogue, arguments.body)
    with timed_reading() as reading:
        part, source = read()
    scene = place_options.scene_of_file(arguments.scene)
    approach, forbidden = constraint_options.constraints_of(arguments, scene)
    request = PlanRequest(
        planner=arguments.planner,
        seed=arguments.seed,
        time_budget_s=arguments.time,
        n_grasps=arguments.grasps,
        friction=options.friction_of(arguments.friction, arguments.friction_palm, part.friction),
        max_evaluations=arguments.evaluations,
        verification=arguments.verify,
        approach=approach,
        forbidden=forbidden,
    )
    place = place_options.place_of(arguments, part, catalogue)
    status.enter("loading the planner")  # not before the request was found to be good: 2 s
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.plan.progress import Monitor

    ready_to_plan(request.planner, status.note)
    status.enter("preparing")
    monitor = Monitor(request.time_budget_s, status.show, stopped, reading_s=reading.seconds)
    from gpis_grasp_planner.store.answering import answer_with_store
    from gpis_grasp_planner.store.grasp_store import GraspStore

    store = GraspStore.of(settings.store) if arguments.store else None
    if arguments.store and store is None:
        status.note("gpis-grasp: the grasp store is switched off; --store does nothing")
    planner = GraspPlanner(settings)
    stored = answer_with_store(planner, store, part, request, place, monitor=monitor)
    if store is not None and not stored.kept:
        status.note("gpis-grasp: this answer is not kept in the grasp store")
    if store is not None:
        store.note_uses()
    result = stored.answer.result
    return part, source, result, bool(place)


def _show(result: PlanResult) -> None:
    from gpis_grasp_planner.cli import grasp_table
    from gpis_grasp_planner.hand.description import load_hand

    verified = result.request.verification != "none"
    hand = load_hand(result.hand)
    objective = result.settings.get("objective", {}).get("name", "")
    tables.print_table(grasp_table.grasp_columns(hand, result.grasps, verified, objective))
    print()
    tables.print_text(grasp_table.order_text(result))
    if text := grasp_table.trials_text(result.grasps):
        tables.print_text(text)
    tables.print_text(grasp_table.LEGEND)
    tables.print_text(
        f"{result.evaluations} attempts in {result.elapsed_s:.1f} s; friction "
        f"{result.friction.finger:g} of the fingers, {result.friction.palm:g} of the palm."
    )


def _short_of_time(result: PlanResult) -> tuple[str, ...]:
    """A note where reading and preparing left less than half of the budget."""
    before = sum(result.phase_s.get(phase, 0.0) for phase in ("reading", "preparing"))
    budget = result.request.time_budget_s
    if before < 0.5 * budget or result.request.max_evaluations is not None:
        return ()
    return (
        f"Reading and preparing the part took {before:.1f} s of {budget:g} s; --time "
        f"{math.ceil(before + budget):g} leaves the search as much as you gave.",
    )


def _draw(arguments: argparse.Namespace, part: Part, result: PlanResult) -> None:
    from gpis_grasp_planner.cli import drawing

    path = arguments.picture
    grasp = result.grasps[0] if result.grasps else result.best_attempt
    if arguments.explain and result.lost_palms:
        scene = drawing.scene_of(part, result, options.catalogue_of(arguments.meshes))
        drawing.draw_explained(path, scene, result)
    elif grasp is not None:
        drawing.draw_grasp(path, part, result, grasp)
