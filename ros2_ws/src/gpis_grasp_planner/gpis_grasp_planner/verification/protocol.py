"""The strict protocol: six directions, fresh resets, limits of slip, turn and penetration.

Gravity is off. For each of six directions of the palm frame the part is accelerated by 15 m/s^2
for 2 s, each time from the same state after closing; all six must pass. The part may move 3 cm
and turn 15 degrees relative to the palm, no link may be deeper than 1 mm at the start, and links
of two fingers, or of a finger and the palm, must press on it.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.forked_child import answer_requests, share_out
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import inverse
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.scene.bullet_world import BulletWorld
from gpis_grasp_planner.verification.convex_cover import ConvexCover
from gpis_grasp_planner.verification.engines import engine_names, load, make_engine
from gpis_grasp_planner.verification.motion import PushWatch
from gpis_grasp_planner.verification.reach import FAR, NEAR, Allowance, Reach
from gpis_grasp_planner.verification.result import DirectionResult, Verification
from gpis_grasp_planner.verification.settings import VerificationSettings
from gpis_grasp_planner.verification.start import StartFinder
from gpis_grasp_planner.verification.trial_world import TrialWorld

Array = NDArray[np.float64]

DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3)])
_KEPT_PARTS = 4
_PRESSES_N = 0.05
_FARTHEST_BACK_M = 0.02


@dataclass(frozen=True, eq=False)
class PreparedPart:
    """What verification makes once per mesh; the cover grows with the grasps that are tried."""

    field: DistanceField
    tree: TriangleTree
    cover: ConvexCover

    @classmethod
    def of(
        cls, part: Part, settings: VerificationSettings, field: DistanceField, tree: TriangleTree
    ) -> PreparedPart:
        """With a cover that is empty as yet."""
        cover = ConvexCover(part.working_mesh, field, tree, settings.cover_tolerance_m)
        return cls(field, tree, cover)


_prepared: OrderedDict[tuple[str, str, float], PreparedPart] = OrderedDict()


def prepare(
    part: Part,
    settings: VerificationSettings,
    field: DistanceField | None = None,
    tree: TriangleTree | None = None,
) -> PreparedPart:
    """Make ready to cover a part by convex pieces, once per mesh and tolerance."""
    # the pieces are of the working mesh's faces, whose numbers another simplification changes
    meshes = part.mesh.content_hash, part.working_mesh.content_hash
    key = (*meshes, settings.cover_tolerance_m)
    found = _prepared.get(key)
    if found is None:
        field = field or DistanceField.of(part.working_mesh)
        tree = tree or TriangleTree.of(part.mesh)
        found = _prepared[key] = PreparedPart.of(part, settings, field, tree)
    _prepared.move_to_end(key)
    while len(_prepared) > _KEPT_PARTS:
        _prepared.popitem(last=False)
    return found


class Verifier:
    """Tries grasps of one part; a context manager.

    Parameters
    ----------
    part : Part
    hand : HandDescription
    settings : VerificationSettings
    prepared : PreparedPart, optional
        From :func:`prepare`.
    stop_at_failure : bool
        End a grasp's trial with the first direction that fails.
    whole_cover : bool
        Cover the whole part by convex pieces, not only what a grasp's hand may reach.

    Attributes
    ----------
    worlds : tuple of TrialWorld
        One for each engine of the settings; a grasp has to hold in all of them.
    """

    def __init__(
        self,
        part: Part,
        hand: HandDescription,
        settings: VerificationSettings,
        prepared: PreparedPart | None = None,
        stop_at_failure: bool = True,
        whole_cover: bool = False,
    ):
        self.part, self.hand, self.settings = part, hand, settings
        self.stop_at_failure = stop_at_failure
        self.whole_cover = whole_cover
        self._prepared = prepared or prepare(part, settings)
        self._start = StartFinder.of(hand, self._prepared.field)
        self._reach = Reach.of(hand, part.working_mesh)
        self.worlds = tuple(
            TrialWorld(name, make_engine(name, hand, part, settings), hand, part, settings)
            for name in engine_names(settings.engine)
        )
        self.scene = BulletWorld.of_part(hand, part, self._prepared.field, self._prepared.tree)

    def __enter__(self) -> Verifier:
        self.scene.__enter__()
        for world in self.worlds:
            world.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        for world in self.worlds:
            world.__exit__(None, None, None)
        self.scene.__exit__(None, None, None)

    def use(self, settings: VerificationSettings) -> None:
        """Go on with another friction and mass; other settings must be the same (0.1 ms)."""
        self.settings = settings
        for world in self.worlds:
            world.use(settings)

    def verify(self, grasp: Grasp) -> Verification:
        """Try a grasp as it was planned."""
        start = time.perf_counter()
        depth = self._planned_depth(grasp)
        if depth > self.settings.penetration_limit_m:
            return self._verdict("penetration", start, penetration_m=depth)
        verdict = self._try(grasp.T_object_palm, grasp, depth, start, NEAR)
        if verdict.held and 1e-3 * verdict.largest_slip_mm < NEAR.distance_m:
            return verdict
        if self._covered_far(grasp.T_object_palm, grasp):
            return verdict
        return self._try(grasp.T_object_palm, grasp, depth, start, FAR)

    def verify_displaced(self, grasp: Grasp, T_displacement: Array) -> Verification:
        """Try a grasp on a part that lies elsewhere than was thought.

        `T_displacement` (4, 4) maps the part's frame as it is to the frame as it was estimated.
        The palm comes to where it was planned, or stops before where it would meet the part.
        """
        start = time.perf_counter()
        T = inverse(T_displacement) @ grasp.T_object_palm
        back = self._start.back_until_free(T, grasp.pregrasp_joints, _FARTHEST_BACK_M)
        if back is None:
            return self._verdict("collision", start)
        return self._try(back, grasp, 0.0, start, FAR)

    def close_on(
        self, world: TrialWorld, T_object_palm: Array, grasp: Grasp, allowance: Allowance = FAR
    ) -> bool:
        """Place the hand in a world and close it on the held part; whether it closed in time."""
        self.place_in(world, T_object_palm, grasp, allowance)
        return world.close()

    def place_in(
        self,
        world: TrialWorld,
        T_object_palm: Array,
        grasp: Grasp,
        allowance: Allowance = FAR,
        *,
        together: bool = False,
    ) -> None:
        """Place the hand in a world, about to close on the held part.

        `together`: the fingers are as far from their contacts as they come, each by its own.
        """
        travelled = self._start.together if together else self._start.start_joints
        joints = travelled(T_object_palm, grasp.pregrasp_joints)
        self._cover(T_object_palm, joints, grasp.joints, allowance)
        pieces = self._prepared.cover.pieces
        if world.n_pieces != len(pieces):
            world.take_pieces(pieces)
        world.place(T_object_palm, joints)

    def _cover(self, T_object_palm: Array, start: Array, closed: Array, allowed: Allowance) -> None:
        """Make all convex pieces of the part that the hand may meet in this trial."""
        cover = self._prepared.cover
        faces = None
        if not self.whole_cover:
            faces = self._reach.faces(T_object_palm, start, closed, allowed)
        cover.add(faces)
        if not cover.pieces:  # a hand that reaches nothing still has a part beside it
            cover.add()

    def _covered_far(self, T_object_palm: Array, grasp: Grasp) -> bool:
        """Whether a trial with the wide allowance would have no piece more."""
        start = self._start.start_joints(T_object_palm, grasp.pregrasp_joints)
        faces = self._reach.faces(T_object_palm, start, grasp.joints, FAR)
        return self.whole_cover or self._prepared.cover.covers(faces)

    def _planned_depth(self, grasp: Grasp) -> float:
        self.scene.place_palm(grasp.T_object_palm)
        self.scene.set_joints(grasp.joints)
        return max(self.scene.penetration(link) for link in range(self.hand.n_links))

    def _try(
        self,
        T_object_palm: Array,
        grasp: Grasp,
        depth: float,
        start: float,
        allowance: Allowance,
    ) -> Verification:
        """The verdict of the engines in turn: of the first that fails, else of the most slip."""
        verdicts: list[Verification] = []
        for world in self.worlds:
            verdict = self._try_in(world, T_object_palm, grasp, depth, allowance)
            verdicts.append(replace(verdict, elapsed_s=time.perf_counter() - start))
            if not verdict.held:
                return verdicts[-1]
        most = max(verdicts, key=lambda verdict: verdict.largest_slip_mm)
        return replace(most, elapsed_s=verdicts[-1].elapsed_s)

    def _try_in(
        self,
        world: TrialWorld,
        T_object_palm: Array,
        grasp: Grasp,
        depth: float,
        allowance: Allowance,
    ) -> Verification:
        settings = self.settings
        verdict = replace(self._verdict("", 0.0, penetration_m=depth), engine=world.name)
        if not self.close_on(world, T_object_palm, grasp, allowance):
            return replace(verdict, cause="not closed")
        before = world.part_pose()
        world.release()
        closing = world.motion_since(before)
        contacts = world.contacts()
        links = sorted({c.link for c in contacts if c.force_n > _PRESSES_N})
        depth = max([depth, *(c.depth_m for c in contacts)])
        verdict = replace(
            verdict,
            penetration_m=depth,
            touching=tuple(self.hand.link_names[link] for link in links),
            closing_slip_m=closing.slip_m,
            closing_rotation_rad=closing.rotation_rad,
        )
        if not closing.within(settings):
            return replace(verdict, cause="lost while closing")
        if depth > settings.penetration_limit_m:
            return replace(verdict, cause="penetration")
        if len({self._group(link) for link in links}) < 2:
            return replace(verdict, cause="too few touch")
        results = self._six_directions(world)
        held = all(result.held for result in results) and len(results) == len(DIRECTIONS)
        return replace(verdict, directions=results, held=held, cause="" if held else "slipped")

    def _six_directions(self, world: TrialWorld) -> tuple[DirectionResult, ...]:
        saved = world.save()
        results: list[DirectionResult] = []
        for direction in DIRECTIONS:
            world.restore(saved)
            results.append(self._push(world, direction))
            if self.stop_at_failure and not results[-1].held:
                break
        world.forget(saved)
        return tuple(results)

    def _push(self, world: TrialWorld, direction: Array) -> DirectionResult:
        """One direction: to its end, to the loss of the part, or until it is seen to stay."""
        before = world.part_pose()
        acceleration = self.settings.acceleration_m_s2 * direction
        watch = PushWatch(self.settings)
        while not watch.over:
            step_s = world.run(watch.next_s, acceleration)
            watch.see(step_s, world.motion_since(before))
        return DirectionResult(
            (float(direction[0]), float(direction[1]), float(direction[2])),
            watch.held,
            watch.largest.slip_m,
            watch.largest.rotation_rad,
            watch.elapsed_s,
        )

    def _group(self, link: int) -> str:
        """The finger that a link moves with, or the palm."""
        for finger in self.hand.fingers:
            if link in finger.links:
                return finger.name
        return "palm"

    def _verdict(self, cause: str, start: float, penetration_m: float = 0.0) -> Verification:
        return Verification(
            held=False,
            cause=cause,
            friction=self.settings.friction,
            mass_kg=self.settings.mass_kg,
            directions=(),
            penetration_m=penetration_m,
            touching=(),
            closing_slip_m=0.0,
            closing_rotation_rad=0.0,
            elapsed_s=time.perf_counter() - start,
            engine=self.worlds[0].name,
        )


def verify(
    part: Part,
    hand: HandDescription,
    grasps: Sequence[Grasp],
    settings: VerificationSettings | None = None,
    processes: int = 1,
    stop_at_failure: bool = True,
    displacements: Sequence[Array] | None = None,
) -> list[Verification]:
    """Try grasps of a part by the strict protocol.

    Parameters
    ----------
    part : Part
    hand : HandDescription
    grasps : sequence of Grasp
    settings : VerificationSettings, optional
    processes : int
        More than one forks that many children (10 ms); a free one takes the next grasp.
    stop_at_failure : bool
        End a grasp's trial with the first direction that fails.
    displacements : sequence of (4, 4) arrays, optional
        One per grasp: where the part lies relative to its estimate.

    Returns
    -------
    list of Verification, in the order of the grasps. About 0.5 s a grasp.

    Raises
    ------
    SystemFault
        Where a child ended before it answered.
    """
    settings = settings or VerificationSettings()
    moves = list(displacements) if displacements is not None else [None] * len(grasps)
    prepared = prepare(part, settings)
    make = partial(Verifier, part, hand, settings, prepared, stop_at_failure)
    load(settings.engine, hand)  # here, so that no child needs to
    if min(processes, len(grasps)) <= 1:
        with make() as verifier:
            return [_one(verifier, g, move) for g, move in zip(grasps, moves, strict=True)]
    serve = partial(_serve, make, list(zip(grasps, moves, strict=True)))
    return share_out(serve, range(len(grasps)), processes)


def _one(verifier: Verifier, grasp: Grasp, displacement: Array | None) -> Verification:
    if displacement is None:
        return verifier.verify(grasp)
    return verifier.verify_displaced(grasp, displacement)


def _serve(
    make: Callable[[], Verifier],
    trials: Sequence[tuple[Grasp, Array | None]],
    connection: Connection,
) -> None:
    with make() as verifier:

        def answer(index: int) -> Verification | Exception:
            try:
                return _one(verifier, *trials[index])
            except Exception as error:
                return error  # the parent raises it

        answer_requests(answer, connection)
