"""Verdicts over hand-made grasps, good and bad, and their evidence."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.protocol import DIRECTIONS, Verifier, prepare, verify
from gpis_grasp_planner.verification.settings import VerificationSettings

GraspMaker = Callable[[Part, np.ndarray], Grasp]
BoxMaker = Callable[[float, float, float], Part]


def one(part: Part, hand: HandDescription, grasp: Grasp, **settings: float):
    [verdict] = verify(part, hand, [grasp], VerificationSettings(**settings))
    return verdict


def test_a_firm_power_grasp_holds(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    verdict = one(bar, hand, firm)
    assert verdict.held
    assert verdict.cause == ""
    assert len(verdict.directions) == 6
    assert all(direction.held for direction in verdict.directions)
    tried = np.array([direction.direction for direction in verdict.directions])
    assert np.array_equal(tried, DIRECTIONS)
    assert verdict.largest_slip_mm < 1.0
    assert verdict.largest_rotation_deg < 2.0
    assert verdict.penetration_m < 2e-4
    assert {"bh_palm_link", "bh_finger_1_distal_link", "bh_finger_3_distal_link"} <= set(
        verdict.touching
    )
    assert json.loads(json.dumps(verdict.as_dict()))["largest_slip_mm"] == verdict.largest_slip_mm


def test_without_friction_a_bar_slides_out(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    [verdict] = verify(bar, hand, [firm], VerificationSettings(friction=0.0), stop_at_failure=False)
    assert not verdict.held
    along = [d for d in verdict.directions if abs(d.direction[0]) == 1.0]
    assert len(along) == 2
    assert not any(d.held for d in along)
    assert all(d.simulated_s < 0.5 for d in along)


def test_a_part_on_two_parallel_fingers_without_friction_falls(
    hand: HandDescription, make_box: BoxMaker, grasp_of: GraspMaker, palm_face: float
) -> None:
    """F1 and F2 press it to nothing, or only to the palm; F3 finds nothing."""
    plate = make_box(0.16, 0.04, 0.04)
    away = grasp_of(plate, np.array([0.0, -0.09, palm_face + 0.06]))
    on_palm = grasp_of(plate, np.array([0.0, -0.05, palm_face + 0.0205]))
    for grasp in (away, on_palm):
        assert not one(plate, hand, grasp, friction=0.0).held


def test_a_cage_without_contact_is_no_grasp(
    hand: HandDescription, make_box: BoxMaker, grasp_of: GraspMaker, palm_face: float
) -> None:
    """The closed fingers surround a small part that none of them touches."""
    small = make_box(0.02, 0.02, 0.01)
    verdict = one(small, hand, grasp_of(small, np.array([0.0, 0.0, palm_face + 0.02])))
    assert not verdict.held
    assert verdict.cause == "too few touch"
    assert verdict.touching == ()


def test_a_grasp_in_penetration_is_refused(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    inner = [finger.inner_joint for finger in hand.fingers]
    joints = firm.joints.copy()
    joints[inner] += 0.05
    verdict = one(bar, hand, replace(firm, joints=joints))
    assert not verdict.held
    assert verdict.cause == "penetration"
    assert 0.001 < verdict.penetration_m < 0.01
    assert verdict.directions == ()


def test_a_palm_in_the_part_is_refused(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    T = firm.T_object_palm.copy()
    T[:3, 3] += 0.004 * T[:3, 2]
    verdict = one(bar, hand, replace(firm, T_object_palm=T))
    assert verdict.cause == "penetration"
    assert verdict.penetration_m == pytest.approx(0.004 - 0.0005, abs=7e-4)


def test_an_empty_hand_holds_nothing(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    T = firm.T_object_palm.copy()
    T[:3, 3] -= 0.3 * T[:3, 2]
    verdict = one(bar, hand, replace(firm, T_object_palm=T))
    assert not verdict.held
    assert verdict.cause == "too few touch"


@pytest.mark.parametrize(
    ("name", "ladder"), [("friction", (0.6, 0.2, 0.05)), ("mass_kg", (0.1, 3.0, 6.0))]
)
def test_harder_tests_turn_no_failure_into_a_pass(
    bar: Part, hand: HandDescription, firm: Grasp, name: str, ladder: tuple[float, ...]
) -> None:
    offset = firm.T_object_palm.copy()
    offset[:3, 3] += [0.045, 0.0, 0.0]  # the bar is held near its end
    for grasp in (firm, replace(firm, T_object_palm=offset)):
        held = [one(bar, hand, grasp, **{name: value}).held for value in ladder]
        print(name, ladder, held)
        assert held == sorted(held, reverse=True)
        assert held[0] or grasp is not firm


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_the_bar_slips_along_when_friction_is_used_up(
    engine: str, bar: Part, hand: HandDescription, firm: Grasp
) -> None:
    """Along the bar the contacts can hold mu times the sum of the normal forces, no more.

    Between that and what they hold where every finger is driven back, with its holding instead of
    its pressing force, either may happen.
    """
    friction = 0.3
    settings = VerificationSettings(friction=friction, engine=engine)
    with Verifier(bar, hand, settings) as verifier:
        [world] = verifier.worlds
        assert verifier.close_on(world, firm.T_object_palm, firm)
        world.release()
        normal = sum(contact.force_n for contact in world.contacts())
    capacity = friction * normal
    assert 20.0 < normal < 200.0
    per_mass = replace(settings, mass_kg=4.0)
    results = {}
    beyond = 1.1 * settings.holding_force_n / settings.tip_force_n
    for share in (0.75, beyond):
        pushed = replace(per_mass, acceleration_m_s2=share * capacity / 4.0)
        [verdict] = verify(bar, hand, [firm], pushed, stop_at_failure=False)
        results[share] = [d.held for d in verdict.directions if abs(d.direction[0]) == 1.0]
    assert results == {0.75: [True, True], beyond: [False, False]}


@pytest.mark.parametrize("engine", ["bullet", "mujoco"])
def test_a_smooth_palm_holds_nothing_along_the_bar(
    engine: str, bar: Part, hand: HandDescription, firm: Grasp
) -> None:
    """A push between what the fingers' friction holds and what theirs and the palm's would hold."""
    rough = VerificationSettings(friction=0.3, engine=engine, mass_kg=4.0)
    with Verifier(bar, hand, rough) as verifier:
        [world] = verifier.worlds
        assert verifier.close_on(world, firm.T_object_palm, firm)
        world.release()
        pressed = {"palm": 0.0, "finger": 0.0}
        for contact in world.contacts():
            pressed[hand.link_friction_group[contact.link]] += contact.force_n
    capacity = rough.friction * pressed["finger"]
    beyond = 1.1 * rough.holding_force_n / rough.tip_force_n
    assert beyond * capacity < 0.95 * rough.friction * sum(pressed.values())
    results = {}
    for share, palm in ((0.75, 0.0), (beyond, 0.0), (beyond, 1.0)):
        pushed = replace(rough, acceleration_m_s2=share * capacity / 4.0, palm_friction_share=palm)
        [verdict] = verify(bar, hand, [firm], pushed, stop_at_failure=False)
        results[share, palm] = [d.held for d in verdict.directions if abs(d.direction[0]) == 1.0]
    assert results == {
        (0.75, 0.0): [True, True],
        (beyond, 0.0): [False, False],
        (beyond, 1.0): [True, True],
    }


def test_every_direction_starts_afresh(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    """A second run in the same world and a run in a new one say the same."""
    settings = VerificationSettings(friction=0.1)
    with Verifier(bar, hand, settings, stop_at_failure=False) as verifier:
        first, second = verifier.verify(firm), verifier.verify(firm)
    [third] = verify(bar, hand, [firm], settings, stop_at_failure=False)
    for other in (second, third):
        assert other.held == first.held
        assert [d.held for d in other.directions] == [d.held for d in first.directions]
    assert third.directions == first.directions


def test_processes_give_the_same_verdicts(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    deep = replace(firm, joints=firm.joints + 0.05 * (np.arange(8) > 1))
    alone = verify(bar, hand, [firm, deep])
    shared = verify(bar, hand, [firm, deep], processes=2)
    assert [v.held for v in shared] == [v.held for v in alone] == [True, False]
    assert [v.cause for v in shared] == [v.cause for v in alone]


def test_an_error_in_a_child_is_raised(bar: Part, hand: HandDescription, firm: Grasp) -> None:
    short = replace(firm, joints=firm.joints[:3])
    with pytest.raises(IndexError, match="index 3") as alone:
        verify(bar, hand, [short, firm])
    with pytest.raises(IndexError, match="index 3") as shared:
        verify(bar, hand, [firm, short], processes=2)
    assert str(shared.value) == str(alone.value)


def test_a_part_is_prepared_once(bar: Part) -> None:
    settings = VerificationSettings()
    assert prepare(bar, settings) is prepare(bar, replace(settings, friction=0.3))


def test_a_part_that_is_simplified_otherwise_is_prepared_anew(make_box: BoxMaker) -> None:
    """Pieces are found by the numbers of the simplified mesh's faces."""
    part, settings = make_box(0.04, 0.04, 0.04), VerificationSettings()
    coarse = make_box(0.041, 0.04, 0.04).mesh
    prepare(part, settings)
    other = prepare(replace(part, simplified=coarse), settings)
    assert other is prepare(replace(part, simplified=coarse), settings)
    assert other is not prepare(part, settings)
