"""The constraints one by one: masks against verdicts, verdicts against an independent library."""

from __future__ import annotations

import coal
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.constraint import ClosedHands
from gpis_grasp_planner.grasp.hand_motion import HandPieces
from gpis_grasp_planner.hand.drive import joints_from_motors
from gpis_grasp_planner.plan.constraints import make_constraints
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.surroundings.approach_cone import ApproachCone
from gpis_grasp_planner.surroundings.approach_constraint import ApproachConstraint
from gpis_grasp_planner.surroundings.clearance import Cause, clearances
from gpis_grasp_planner.surroundings.clearance_settings import ClearanceSettings
from gpis_grasp_planner.surroundings.forbidden_region import ForbiddenRegion
from gpis_grasp_planner.surroundings.obstacle_constraint import ObstacleConstraint
from gpis_grasp_planner.surroundings.obstacles import BoxObstacle, SupportPlane, Surroundings
from gpis_grasp_planner.surroundings.place import Place
from gpis_grasp_planner.surroundings.region_constraint import RegionConstraint
from gpis_grasp_planner.surroundings.support_constraint import SupportConstraint

MARGIN = 0.003
RETREAT = 0.1
SETTINGS = ClearanceSettings(margin_m=MARGIN)
PLANE = SupportPlane(np.array([0.0, 0.01, -0.03]), np.array([0.1, -0.2, 0.9]))
BOX = BoxObstacle(
    transform(Rotation.from_euler("xyz", [0.4, -0.7, 0.2]).as_matrix(), [0.05, 0.02, -0.04]),
    np.array([0.06, 0.1, 0.03]),
)
REGION = ForbiddenRegion(BOX.pose, BOX.size, "thread", MARGIN)


def random_hands(hand, n, rng):
    """Palms about the origin, starts and ends of closings: (B, 4, 4), (B, J), (B, J)."""
    T = transform(Rotation.random(n, rng=rng).as_matrix(), rng.uniform(-0.2, 0.2, (n, 3)))
    spread = rng.uniform(0.0, np.pi, (n, 1))
    start = rng.uniform(0.0, 1.5, (n, len(hand.fingers)))
    end = np.minimum(start + rng.uniform(0.0, 1.2, start.shape), 2.4)
    return T, joints_from_motors(hand, spread, start), joints_from_motors(hand, spread, end)


def closed_hands(hand, T, start, end, positions=None):
    n = len(T)
    positions = np.zeros((n, 1, 3)) if positions is None else positions
    count = np.full(n, positions.shape[1] if positions.any() else 0)
    return ClosedHands(hand, T, start, end, count, positions, RETREAT)


def make(name, hand):
    return {
        "support": lambda: SupportConstraint(hand, PLANE, MARGIN, RETREAT),
        "obstacles": lambda: ObstacleConstraint(hand, (BOX,), SETTINGS, RETREAT),
        "region": lambda: RegionConstraint(hand, REGION, SETTINGS, RETREAT),
        "cone": lambda: ApproachConstraint(np.array([0.0, 0.6, -0.8]), 70.0, np.eye(4)),
    }[name]()


NAMES = ("support", "obstacles", "region", "cone")


@pytest.mark.parametrize("name", NAMES)
def test_a_mask_rejects_nothing_that_the_verdict_allows(name, planner, rng):
    constraint = make(name, planner.hand)
    T, start, end = random_hands(planner.hand, 3000, rng)
    blocked = constraint.verdict(closed_hands(planner.hand, T, start, end)).blocked
    whole, palm = constraint.allows(T, start), constraint.allows_palm(T, start)
    assert not (~whole & ~blocked).any()
    assert not (~palm & whole).any()
    # and rejects for whatever end of the closing, but not everything
    assert 100 < (~whole).sum() < 2900
    assert (blocked & whole).sum() >= (0 if name == "cone" else 1)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_asked_alone_is_answered_as_in_a_batch(name, planner, rng):
    constraint = make(name, planner.hand)
    T, start, end = random_hands(planner.hand, 40, rng)
    together = constraint.verdict(closed_hands(planner.hand, T, start, end)).cause
    alone = [
        constraint.verdict(closed_hands(planner.hand, T[[i]], start[[i]], end[[i]])).cause[0]
        for i in range(40)
    ]
    assert list(together) == alone
    np.testing.assert_array_equal(
        constraint.allows(T, start),
        [constraint.allows(T[[i]], start[[i]])[0] for i in range(40)],
    )
    assert constraint.allows(T[:0], start[:0]).shape == (0,)


@pytest.mark.parametrize("name", ["support", "obstacles"])
def test_the_verdict_is_that_of_clearance(name, planner, rng):
    T, start, end = random_hands(planner.hand, 400, rng)
    closed = closed_hands(planner.hand, T, start, end)
    around = Surroundings(PLANE) if name == "support" else Surroundings(None, (BOX,))
    found = clearances(HandPieces.of(planner.hand), closed.motions, around, SETTINGS)
    expected = [clearance.cause for clearance in found]
    assert list(make(name, planner.hand).verdict(closed).cause) == expected
    assert len(set(expected)) >= 5  # every phase


def coal_distance(referee, T, joints, body, pose):
    return referee.distance(referee.link_poses(T, joints), body, pose)


@pytest.mark.parametrize("name", ["support", "obstacles", "region"])
def test_the_mask_is_the_independent_librarys(name, planner, referee, rng):
    """The open hand at its place and on the approach, in steps, by coal."""
    constraint = make(name, planner.hand)
    T, start, _ = random_hands(planner.hand, 120, rng)
    if name == "support":
        body, pose = coal.Halfspace(PLANE.normal, float(PLANE.normal @ PLANE.point)), np.eye(4)
    else:
        body, pose = coal.Box(*BOX.size), BOX.pose
    nearest = np.full(len(T), np.inf)
    for i in range(len(T)):
        for step in np.linspace(0.0, RETREAT, 21):
            back = T[i].copy()
            back[:3, 3] -= step * T[i, :3, 2]
            nearest[i] = min(nearest[i], coal_distance(referee, back, start[i], body, pose))
    allowed = constraint.allows(T, start)
    # between two steps of 5 mm a hand comes nearer by 2.5 mm at most
    assert (nearest[allowed] >= MARGIN - 1e-6).all()
    assert (nearest[~allowed] < MARGIN + 0.0025).all()
    assert 10 < allowed.sum() < 110


def test_a_lifted_hand_is_just_allowed(planner, rng):
    support = make("support", planner.hand)
    T, start, _ = random_hands(planner.hand, 500, rng)
    allowed = support.allows(T, start)
    lifted = support.nearest(T, start)
    np.testing.assert_array_equal(lifted[allowed], T[allowed])
    np.testing.assert_array_equal(lifted[:, :3, :3], T[:, :3, :3])
    assert support.allows(lifted, start).all()
    rise = (lifted - T)[:, :3, 3]
    height = rise @ PLANE.normal
    np.testing.assert_allclose(rise, height[:, None] * PLANE.normal, atol=1e-12)
    short = lifted.copy()
    short[:, :3, 3] -= 1e-5 * PLANE.normal
    assert not support.allows(short[~allowed], start[~allowed]).any()


def test_a_palm_is_turned_into_the_cone_about_its_face(rng, planner):
    pivot = np.eye(4)
    pivot[2, 3] = 0.079
    axis = np.array([0.0, 0.6, -0.8])
    cone = ApproachConstraint(axis, 35.0, pivot)
    T, start, _ = random_hands(planner.hand, 500, rng)
    T[0, :3, :3] = Rotation.align_vectors([-axis], [[0, 0, 1]])[0].as_matrix()
    angle = np.arccos(np.clip(T[:, :3, 2] @ axis, -1.0, 1.0))
    np.testing.assert_array_equal(cone.allows(T, start), angle <= np.deg2rad(35.0))
    turned = cone.nearest(T, start)
    assert cone.allows(turned, start).all()
    np.testing.assert_array_equal(turned[cone.allows(T, start)], T[cone.allows(T, start)])
    np.testing.assert_allclose((turned @ pivot)[:, :3, 3], (T @ pivot)[:, :3, 3], atol=1e-12)
    between = Rotation.from_matrix(turned[:, :3, :3] @ T[:, :3, :3].transpose(0, 2, 1))
    np.testing.assert_allclose(
        between.magnitude(), np.maximum(angle - np.deg2rad(35.0), 0.0), atol=1e-7
    )


def test_a_contact_in_a_region_blocks_whatever_the_links_do(planner):
    hand = planner.hand
    region = RegionConstraint(hand, REGION, SETTINGS, RETREAT)
    far = np.eye(4)
    far[2, 3] = -1.0
    joints = np.zeros((1, hand.n_joints))
    inside = BOX.pose[:3, :3] @ (0.49 * BOX.size) + BOX.pose[:3, 3]
    outside = BOX.pose[:3, :3] @ (0.51 * BOX.size) + BOX.pose[:3, 3]
    for point, cause in ((inside, Cause.REGION), (outside, None)):
        closed = closed_hands(hand, far[None], joints, joints, point[None, None])
        assert region.verdict(closed).cause[0] == cause
    unset = ClosedHands(
        hand, far[None], joints, joints, np.zeros(1, int), inside[None, None], RETREAT
    )
    assert region.verdict(unset).cause[0] is None


def test_a_cone_is_seen_from_the_part():
    T = transform(Rotation.from_euler("x", 90, degrees=True).as_matrix(), np.zeros(3))
    assert ApproachCone([0, 0, -2], 30.0).axis_in_object(T) == pytest.approx([0, -1, 0])
    assert ApproachCone([0, 0, -2], 30.0, "object").axis_in_object(T) == pytest.approx([0, 0, -1])


def test_the_json_forms_go_round():
    cone = ApproachCone([1.0, 2.0, -2.0], 12.5, "object")
    again = ApproachCone.from_mapping(cone.as_mapping())
    np.testing.assert_allclose(again.axis, cone.axis, rtol=1e-15)  # normalised once more
    assert (again.half_angle_deg, again.frame) == (cone.half_angle_deg, cone.frame)
    region = ForbiddenRegion.from_mapping(REGION.as_mapping())
    np.testing.assert_allclose(region.pose, REGION.pose, atol=1e-12)
    assert (region.size.tolist(), region.name) == (BOX.size.tolist(), "thread")
    assert region.margin_m == MARGIN


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: ApproachCone([0, 0, 0], 10.0), "length 0"),
        (lambda: ApproachCone([0, 0, -1], 200.0), "0 to 180"),
        (lambda: ApproachCone([0, 0, -1], float("nan")), "0 to 180"),
        (lambda: ApproachCone([0, 0, -1], 10.0, "camera"), "world, object"),
        (lambda: ApproachCone([0, 0], 10.0), "3 finite numbers"),
        (lambda: ApproachCone.from_mapping({"axis": [0, 0, -1]}), "0 to 180"),
        (lambda: ApproachCone.from_mapping({"axes": [0, 0, -1]}), "'axes'"),
        (lambda: ForbiddenRegion(np.eye(4), [0.1, 0.1, 0.1], "a", 1.0), "0 to 0.1 m"),
        (lambda: ForbiddenRegion(np.eye(4), [0.1, 0.1, -0.1], "a"), "not negative"),
        (lambda: ForbiddenRegion.from_mapping({}), "3 finite numbers"),
        (lambda: ForbiddenRegion.from_mapping({"size": [1, 1, 1], "margin_m": "x"}), "0 to 0.1"),
    ],
)
def test_what_makes_no_sense_is_refused(build, words):
    with pytest.raises(RequestError, match=words) as caught:
        build()
    assert caught.value.code == ErrorCode.INVALID_SCENE


def test_the_constraints_of_a_plan(planner):
    nothing = make_constraints(planner.hand, PlanRequest(), Place(), planner.settings)
    assert nothing == ()
    request = PlanRequest(approach=ApproachCone([0, 0, -1], 20.0), forbidden=(REGION,))
    T = transform(np.eye(3), [1.0, 2.0, 3.0])
    place = Place(
        T, Surroundings(SupportPlane([0, 0, 3.0], [0, 0, 1]), (BOX.__class__(T, BOX.size),))
    )
    made = make_constraints(planner.hand, request, place, planner.settings)
    assert [c.name for c in made] == ["approach direction", "support", "obstacles", "thread"]
    [_, support, *_] = made
    assert support.plane.point == pytest.approx([-1.0, -2.0, 0.0])
