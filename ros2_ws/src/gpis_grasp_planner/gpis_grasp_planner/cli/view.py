"""Show a part, a document's grasps, a running search or what a node publishes in the browser."""

from __future__ import annotations

import argparse
import json
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from gpis_grasp_planner.cli import options, place_options
from gpis_grasp_planner.cli.exit_codes import SUCCESS
from gpis_grasp_planner.cli.interrupt import raise_on_signals

if TYPE_CHECKING:
    from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
    from gpis_grasp_planner.plan.settings import PlannerSettings
    from gpis_grasp_planner.view.grasp_scene import GraspScene
    from gpis_grasp_planner.view.page import GraspPage

EXAMPLES = """\
examples:
  gpis-grasp view grasps.json
  gpis-grasp view mug --model
  gpis-grasp view mug --live --time 20 --support lowest
  gpis-grasp view --ros
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of 'view'."""
    parser.add_argument(
        "target",
        metavar="MESH|GRASPS.json",
        nargs="?",
        help="a document of 'plan --json', or a part; not with --ros",
    )
    parser.add_argument(
        "--ros", action="store_true", help="show the grasps that a node publishes, as they come"
    )
    parser.add_argument(
        "--namespace", default="/", metavar="NS", help="of the node, with --ros; default: /"
    )
    parser.add_argument(
        "--live", action="store_true", help="plan grasps of the part, and show them as they come"
    )
    parser.add_argument(
        "--time", type=float, default=10.0, metavar="S", help="budget of --live; default: 10"
    )
    parser.add_argument("--seed", type=int, default=0, help="of --live; default: 0")
    parser.add_argument(
        "--model",
        action="store_true",
        help="show the charts at the best grasp's contacts and the search's two ellipsoids",
    )
    parser.add_argument("--host", default="127.0.0.1", help="where to listen; 127.0.0.1")
    parser.add_argument("--port", type=int, default=8080, help="the next free one from 8080 on")
    parser.add_argument(
        "--json", action="store_true", help="print the address as JSON, in one line, before serving"
    )
    parser.add_argument("--mesh", metavar="MESH", help="the document's mesh, where it is elsewhere")
    options.add_hand(parser)
    options.add_mesh_file(parser)
    options.add_catalogue(parser)
    options.add_settings(parser)
    place_options.add_place(parser)


def run(arguments: argparse.Namespace) -> int:
    """Serve until Ctrl-C."""
    from gpis_grasp_planner.errors import RequestError

    if arguments.ros == (arguments.target is not None):
        raise RequestError(
            "'view' takes either a part, or a document, or --ros. Such as: gpis-grasp view mug"
        )
    if arguments.ros:
        from gpis_grasp_planner.cli.view_ros import serve

        return serve(arguments)
    document = arguments.target.endswith(".json")
    if document and arguments.live:
        raise RequestError(f"--live plans a part; {arguments.target} is a document. Name a mesh.")
    scene = _scene_of_document(arguments) if document else _scene_of_part(arguments)
    from gpis_grasp_planner.view.page import GraspPage

    page = GraspPage(scene, arguments.host, arguments.port)
    try:
        raise_on_signals()
        say_address(arguments, page.address, scene.part.mesh_id)
        if arguments.live:
            scene = _plan_live(arguments, scene, page)
        if arguments.model:
            _add_model(arguments, scene, page)
        threading.Event().wait()
    except KeyboardInterrupt:
        return SUCCESS
    finally:
        page.close()
    return SUCCESS


def say_address(arguments: argparse.Namespace, address: str, shown: str) -> None:
    """Print where the page is, at once: a program may wait for it."""
    if arguments.json:
        print(json.dumps({"address": address, "shows": shown}), flush=True)
    else:
        print(f"{address} shows {shown}; Ctrl-C ends.", flush=True)


def _settings(arguments: argparse.Namespace) -> tuple[PlannerSettings, CatalogueSettings]:
    """Of files, `--set` and `--hand`."""
    assignments = options.with_hand(arguments.assignments, arguments.hand)
    return options.read_settings(arguments.settings, assignments)


def _scene_of_document(arguments: argparse.Namespace) -> GraspScene:
    from gpis_grasp_planner.cli.drawing import scene_of
    from gpis_grasp_planner.plan.document import read_document

    arguments.document = Path(arguments.target)
    document = read_document(arguments.document)
    part = options.part_of_document(document, arguments)
    return scene_of(part, document.result, options.catalogue_of(arguments.meshes))


def _scene_of_part(arguments: argparse.Namespace) -> GraspScene:
    from gpis_grasp_planner.hand.description import load_hand
    from gpis_grasp_planner.view.grasp_scene import GraspScene

    settings, catalogue_settings = _settings(arguments)
    catalogue = options.catalogue_of(arguments.meshes, catalogue_settings)
    part, _ = options.find_part(arguments.target, arguments.unit, catalogue, arguments.body)
    place = place_options.place_of(arguments, part, catalogue)
    hand = load_hand(settings.hand.model)
    return GraspScene(part, hand, place, cone_edges=settings.scene.cone_edges)


def _plan_live(arguments: argparse.Namespace, scene: GraspScene, page: GraspPage) -> GraspScene:
    """Plan, showing the best grasp that held so far, and at the end all of the answer."""
    from dataclasses import replace

    from gpis_grasp_planner.cli.preparation import ready_to_plan
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.plan.progress import Monitor, Progress
    from gpis_grasp_planner.plan.request import PlanRequest

    request = PlanRequest(seed=arguments.seed, time_budget_s=arguments.time, verification="rank")
    settings, _ = _settings(arguments)
    ready_to_plan(request.planner, page.say)
    shown = None

    def show(progress: Progress) -> None:
        nonlocal shown
        page.say(
            f"**{progress.phase}**, {progress.elapsed_s:.0f} of {progress.time_budget_s:g} s: "
            f"{progress.evaluations} hands, best epsilon {progress.best_epsilon:.4f}, "
            f"{progress.n_held} of {progress.n_tried} tried held"
        )
        if progress.best_held is not None and progress.best_held is not shown:
            shown = progress.best_held
            page.show_grasps(replace(scene, grasps=(shown,)))

    monitor = Monitor(request.time_budget_s, show)
    result = GraspPlanner(settings).answer(scene.part, request, scene.place, monitor=monitor).result
    page.say(f"**{result.code.name}**: {result.message}")
    best = result.best_attempt
    found = replace(
        scene,
        grasps=result.grasps or (() if best is None else (best,)),
        lost_palms=result.lost_palms,
        funnel=result.funnel,
    )
    page.show_grasps(found)
    return found


def _add_model(arguments: argparse.Namespace, scene: GraspScene, page: GraspPage) -> None:
    from gpis_grasp_planner.plan.planner import GraspPlanner
    from gpis_grasp_planner.view.grasp_scene import search_model

    settings, _ = _settings(arguments)
    atlas = GraspPlanner(settings).prepare(scene.part).atlas
    page.add_model(*search_model(scene, atlas, settings.hpp.palm_clearance_m))
