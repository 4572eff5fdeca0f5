"""Compile everything once: a tiny plan on a generated box, with every planner.

    python -m gpis_grasp_planner.plan.warm_up

What was compiled is kept on disk, so that later processes load it in a fraction of a second instead
of compiling for a minute. The set-up calls this; so does :func:`make_ready` for whoever starts the
clock of a budget, where that has not been done on this machine.
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection

import numpy as np

from gpis_grasp_planner.compiled import is_ready, mark_ready
from gpis_grasp_planner.compiled_cache import remove_stale_caches
from gpis_grasp_planner.forked_child import answer_requests, share_out, usable_cores
from gpis_grasp_planner.geometry.cloud.closed_surface import CloudProcess
from gpis_grasp_planner.geometry.cloud.process import Observations
from gpis_grasp_planner.geometry.directions import even_directions
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.ray_crossings import crossing_numbers, outward_votes
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.geometry.welding import merge_equal
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.link_mesh import convex_hull
from gpis_grasp_planner.hand.settings import DEFAULT_HAND
from gpis_grasp_planner.plan.closing_balance import with_balance
from gpis_grasp_planner.plan.objective import make_objective, reported_measures
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.scene.bullet_evaluator import BulletEvaluator
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.archive import GraspArchive
from gpis_grasp_planner.search.contacts.grips import pinches, triads
from gpis_grasp_planner.search.context import PlanningContext
from gpis_grasp_planner.search.finalists import choose_finalists
from gpis_grasp_planner.search.searches import PLANNERS, check_planner, make_search
from gpis_grasp_planner.surface.atlas import SurfaceAtlas
from gpis_grasp_planner.surface.implicit_surface import fit_part
from gpis_grasp_planner.surface.settings import SurfaceSettings
from gpis_grasp_planner.surroundings.clearance import clear_grasps
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.hold_probability import rank_under_uncertainty
from gpis_grasp_planner.surroundings.obstacles import (
    BoxObstacle,
    MeshObstacle,
    SupportPlane,
    Surroundings,
)
from gpis_grasp_planner.surroundings.pregrasp import narrow_pregrasp
from gpis_grasp_planner.surroundings.support_constraint import SupportConstraint
from gpis_grasp_planner.surroundings.uncertainty_settings import UncertaintySettings
from gpis_grasp_planner.verification.convex_cover import ConvexCover
from gpis_grasp_planner.verification.engines import load, second_engines
from gpis_grasp_planner.verification.protocol import PreparedPart, Verifier
from gpis_grasp_planner.verification.settings import VerificationSettings

ATTEMPTS = 200
_SURE = "random-adaption"
_CLOUD_POINTS = 20
MOST_SECONDS = 3.0
FIELD_CELLS = 24


def box_part() -> Part:
    """Return a box of 40 x 50 x 70 mm that the hand grasps easily."""
    half = np.array([0.02, 0.025, 0.035])
    mesh = convex_hull(half * np.array(list(itertools.product((-1.0, 1.0), repeat=3))))
    volume = float(8.0 * half.prod())
    return Part("warm-up box", mesh, np.zeros(3), 1000.0 * volume, volume, True)


def make_ready(planner: str) -> bool:
    """Compile what a planner needs (a minute), unless that lies on disk; whether it had to.

    Raises
    ------
    RequestError
        For an unknown planner.
    """
    check_planner(planner)
    if is_ready(planner):
        return False
    warm_up([planner])
    return True


def warm_up(
    planners: Sequence[str] | None = None, say: Callable[[str], None] = lambda _: None
) -> int:
    """Run a tiny fit and a tiny plan with each planner.

    Parameters
    ----------
    planners : sequence of str, optional
        Names of ``search.searches.PLANNERS``; default: all.
    say : callable
        Takes one line of text per step.

    Returns
    -------
    n_grasps : int
        Grasps found; more than 0 where everything works.

    Notes
    -----
    About 2 s with everything compiled, more than a minute without.
    """
    part, hand = box_part(), load_hand(DEFAULT_HAND)
    settings = PlannerSettings(scene=SceneSettings(field_cells=FIELD_CELLS))
    began = time.monotonic()
    field, tree = DistanceField.of(part.mesh, cells=FIELD_CELLS), TriangleTree.of(part.mesh)
    say(f"distance field and triangle tree: {time.monotonic() - began:.1f} s")
    began = time.monotonic()
    atlas = SurfaceAtlas(fit_part(part.mesh, settings.surface))
    say(f"implicit surface: {time.monotonic() - began:.1f} s")
    friction = Friction(0.6, 0.6)
    names = list(planners or PLANNERS)

    def found_by(name: str) -> Sequence[Grasp]:
        began = time.monotonic()
        compiled = CompiledEvaluator(hand, part, friction, settings.scene, field, tree)
        evaluator = with_balance(compiled, hand, part, settings)
        context = PlanningContext(
            part=part,
            hand=hand,
            evaluator=evaluator,
            atlas=atlas,
            archive=GraspArchive(part.max_radius, make_objective(settings)),
            settings=settings.search,
            rng=np.random.default_rng(0),
            reported=reported_measures(settings),
        )
        search = make_search(name, context)
        search.step()  # compiles
        end = time.monotonic() + MOST_SECONDS
        while not (search.finished or evaluator.n_attempts >= ATTEMPTS or time.monotonic() > end):
            search.step()
        found = choose_finalists(context, 2, None)
        say(f"planner {name}: {time.monotonic() - began:.1f} s")
        return found

    grasps = [grasp for name in names for grasp in found_by(name)]
    if not grasps:  # what follows needs some, and a slow planner finds none in so few attempts
        names.append(_SURE)
        grasps = list(found_by(_SURE))
    began = time.monotonic()
    with BulletEvaluator(hand, part, friction, settings.scene, field, tree) as bullet:
        bullet.confirm(grasps[:1])
    say(f"confirmation: {time.monotonic() - began:.1f} s")
    began = time.monotonic()
    evaluator = CompiledEvaluator(hand, part, friction, settings.scene, field, tree)
    warm_up_placing(evaluator, part, tree, grasps[:2])
    say(f"placing: {time.monotonic() - began:.1f} s")
    warm_up_judging(part, tree)
    warm_up_cloud()
    began = time.monotonic()
    warm_up_trials(part, field, tree, grasps[:1])
    say(f"trials: {time.monotonic() - began:.1f} s")
    for name in names:
        mark_ready(name)
    return len(grasps)


def load_compiled() -> None:
    """Load what lies on disk and what is made once a process, so that no order's clock runs then.

    Compiled code (0.4 s), the physics engine (0.2 s), and tables of the hand's grips (0.1 s).
    """
    compile_group("moves")
    compile_group("attempts")
    hand, settings = load_hand(DEFAULT_HAND), PlannerSettings()
    engine = settings.verification.engine
    for name in (engine, *second_engines(engine)):
        load(name, hand)
    pinches(hand, settings.adaption.spread_max_deg)
    triads(hand, settings.adaption.spread_max_deg)


def compile_group(group: str) -> None:
    """Compile or load one of the two halves of what every planner needs.

    Parameters
    ----------
    group : str
        ``attempts`` (closing, contacts, quality) or ``moves`` (surface, field, tree, free hands).
    """
    part, hand = box_part(), load_hand(DEFAULT_HAND)
    settings = PlannerSettings(scene=SceneSettings(field_cells=FIELD_CELLS))
    compiled = CompiledEvaluator(hand, part, Friction(0.6, 0.6), settings.scene)
    evaluator = with_balance(compiled, hand, part, settings)
    # A batch of none runs no loop, but every function of the loop is there afterwards.
    poses, vectors = np.empty((0, 4, 4)), np.empty((0, 3))
    preshapes = np.empty((0, len(hand.preshape)))
    if group == "attempts":
        evaluator.attempt(poses, preshapes)
        evaluator.attempt_from(poses, np.empty((0, hand.n_joints)))
        return
    surface = fit_part(part.mesh, SurfaceSettings(n_samples=50))
    surface.value(surface.points[:1])
    compiled.tree.nearest(surface.points[:1])
    ConvexCover(part.mesh, compiled.field, compiled.tree).add()
    evaluator.clear_palm(poses, vectors, preshapes, np.empty(0))


def warm_up_judging(part: Part, tree: TriangleTree) -> None:
    """Weld and orient the part's faces, as when a file is read."""
    faces = part.mesh.faces
    merge_equal(part.mesh.vertices, faces.astype(np.int64))
    crossing_numbers(tree, part.mesh.vertices[:1])
    outward_votes(tree, np.zeros(len(faces), dtype=np.int64), 1)


def warm_up_cloud() -> None:
    """Fit the process of a point cloud, and ask it for all that its surface is made of."""
    points = even_directions(_CLOUD_POINTS)
    process = CloudProcess(Observations(points, points, np.full(len(points), 0.1), 0.2))
    process.grid(4)
    process.deviation(points)
    process.draws(1, points, points, seed=0)


def warm_up_trials(
    part: Part, field: DistanceField, tree: TriangleTree, grasps: Sequence[Grasp]
) -> None:
    """Cover the part and try a grasp in physics: in children it would be compiled for one alone."""
    hand, settings = load_hand(DEFAULT_HAND), VerificationSettings(duration_s=0.05)
    prepared = PreparedPart(field, tree, ConvexCover(part.mesh, field, tree))
    with Verifier(part, hand, settings, prepared) as verifier:
        for grasp in grasps:
            verifier.verify(grasp)
            verifier.verify_displaced(grasp, np.eye(4))


def compile_side_by_side() -> None:
    """Compile in two processes what every planner needs: two minutes become little more than one.

    What both halves call is compiled by both; that costs less than it saves.
    """

    def serve(connection: Connection) -> None:
        answer_requests(_compile_more, connection)

    share_out(serve, ["attempts", "moves"], 2)


def _compile_more(group: str) -> None:
    """One half, and with the shorter one what only some planners or a place need."""
    compile_group(group)
    if group == "moves":
        part, hand = box_part(), load_hand(DEFAULT_HAND)
        scene = SceneSettings(field_cells=FIELD_CELLS)
        evaluator = CompiledEvaluator(hand, part, Friction(0.6, 0.6), scene)
        poses, joints = np.empty((0, 4, 4)), np.empty((0, hand.n_joints))
        evaluator.guided_potential(poses, joints)
        evaluator.approach(poses, joints, 0.1)
        evaluator.postures(poses, np.empty((0, 1 + len(hand.fingers))))


def warm_up_placing(
    evaluator: CompiledEvaluator, part: Part, tree: TriangleTree, grasps: Sequence[Grasp]
) -> None:
    """Hold grasps against a plane, a box and a mesh, narrow their pre-grasps, disturb one."""
    hand = evaluator.hand
    aside = np.eye(4)
    aside[0, 3] = 0.5
    support = SupportPlane(np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0]))
    around = Surroundings(
        support,
        (BoxObstacle(aside, np.full(3, 0.1)), MeshObstacle(aside, part.mesh)),
    )
    settings = ClearanceSettings()
    constraint = SupportConstraint(hand, support, settings.margin_m, 0.1)
    constraint.allows(
        np.stack([g.T_object_palm for g in grasps]), np.stack([g.pregrasp_joints for g in grasps])
    )
    clear_grasps(hand, grasps, around, settings)
    narrow_pregrasp(hand, grasps, tree, settings.pregrasp_clearance_m)
    points = UncertaintySettings(method="unscented")
    rank_under_uncertainty(
        evaluator, hand, grasps[:1], 1e-6 * np.eye(6), points, np.random.default_rng(0)
    )


def main() -> int:
    """Warm up and say what it does."""

    def say(text: str) -> None:
        sys.stdout.write(f"warm-up: {text}\n")
        sys.stdout.flush()

    remove_stale_caches()
    if not all(map(is_ready, PLANNERS)):
        say("compiling what is not yet on disk (one to two minutes of two cores, once)")
        if usable_cores() > 1:
            began = time.monotonic()
            compile_side_by_side()
            say(f"two halves side by side: {time.monotonic() - began:.1f} s")
    n_grasps = warm_up(say=say)
    say(f"done, {n_grasps} grasps of a box")
    return 0 if n_grasps else 1


if __name__ == "__main__":
    sys.exit(main())
