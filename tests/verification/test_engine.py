"""What every engine has to do, by answers that are known."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import inverse, transform
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.verification.engine import Engine
from gpis_grasp_planner.verification.engines import make_engine
from gpis_grasp_planner.verification.inertia import inertia_of
from gpis_grasp_planner.verification.settings import VerificationSettings
from gpis_grasp_planner.verification.trial_world import TrialWorld

pytestmark = pytest.mark.parametrize("name", ["bullet", "mujoco"])


@contextmanager
def far_away(name: str, hand: HandDescription, part: Part, mass_kg: float) -> Iterator[Engine]:
    """An entered engine with a free part a metre before the palm."""
    with make_engine(name, hand, part, VerificationSettings()) as engine:
        engine.take_pieces([part.mesh.vertices])
        engine.place(transform(np.eye(3), np.array([0.0, 0.0, 1.0])), np.zeros(hand.n_joints))
        engine.carry(mass_kg, damped=False)
        yield engine


@pytest.mark.parametrize("mass_kg", [0.01, 2.0])
def test_a_free_part_goes_as_newton_says(
    name: str, mass_kg: float, hand: HandDescription, make_box: Callable[..., Part]
) -> None:
    acceleration = np.array([3.0, -2.0, 1.0])
    with far_away(name, hand, make_box(0.02, 0.04, 0.06), mass_kg) as engine:
        before = engine.part_pose()
        engine.step(96, mass_kg * acceleration)
        after = engine.part_pose()
        t = 96 * engine.step_s
    # the steps' own rule lies half a step off the integral
    assert after[:3, 3] - before[:3, 3] == pytest.approx(0.5 * acceleration * t**2, rel=0.02)
    assert after[:3, :3] == pytest.approx(np.eye(3), abs=1e-9)


def test_an_open_flat_mesh_can_be_placed_and_let_go(
    name: str, hand: HandDescription, make_box: Callable[..., Part]
) -> None:
    """A sheet that was modelled as one face has pieces with a thickness, but a flat hull."""
    corners = np.array([[x, y, 0.0] for x in (-0.03, 0.03) for y in (-0.02, 0.02)])
    sheet = TriangleMesh(corners, np.array([[0, 2, 1], [1, 2, 3]], dtype=np.int32))
    part = replace(make_box(0.06, 0.04, 0.002), mesh=sheet, watertight=False)
    plate = make_box(0.06, 0.04, 0.002).mesh.vertices
    with make_engine(name, hand, part, VerificationSettings()) as engine:
        engine.take_pieces([plate])
        engine.place(transform(np.eye(3), np.array([0.0, 0.0, 1.0])), np.zeros(hand.n_joints))
        engine.carry(0.1, damped=False)
        engine.step(10, np.array([0.0, 0.0, -1.0]))
        assert engine.part_pose()[2, 3] < 1.0


@pytest.mark.parametrize(("slope", "friction"), [(0.3, 0.5), (0.5, 0.2), (0.5, 0.0)])
def test_a_part_lies_on_a_plane_or_slides_down_as_coulomb_says(
    name: str, slope: float, friction: float, hand: HandDescription, make_box: Callable[..., Part]
) -> None:
    """Down a slope with g (sin - mu cos), or not at all; without the plane it falls with g."""
    mass, g = 0.2, 9.81
    turn = Rotation.from_rotvec([0.0, slope, 0.0]).as_matrix()
    place = transform(turn, np.array([0.0, 0.0, 1.0]))
    part = make_box(0.06, 0.05, 0.02)
    weight = mass * g * np.array([0.0, 0.0, -1.0])
    with far_away(name, hand, part, mass) as engine:
        engine.place(place, np.zeros(hand.n_joints))
        engine.lay_on(place @ transform(np.eye(3), np.array([0.0, 0.0, -0.01])), friction)
        engine.step(24, weight)  # it sinks in by some hundredths of a millimetre
        engine.halt()
        before = engine.part_pose()
        engine.step(96, weight)
        along = turn.T @ (engine.part_pose()[:3, 3] - before[:3, 3])
        t = 96 * engine.step_s
        engine.lay_on(None, 0.0)
        engine.halt()
        high = engine.part_pose()[2, 3]
        engine.step(96, weight)
        fell = high - engine.part_pose()[2, 3]
    down = max(np.sin(slope) - friction * np.cos(slope), 0.0) * g
    assert along == pytest.approx([0.5 * down * t**2, 0.0, 0.0], rel=0.05, abs=2e-4)
    assert fell == pytest.approx(0.5 * g * t**2, rel=0.05)


def test_a_kept_state_comes_back_as_it_was(
    name: str, hand: HandDescription, bar: Part, firm: Grasp
) -> None:
    settings = VerificationSettings()
    engine = make_engine(name, hand, bar, settings)
    with TrialWorld(name, engine, hand, bar, settings) as world:
        world.take_pieces([bar.mesh.vertices])
        world.place(firm.T_object_palm, firm.pregrasp_joints)
        assert world.close()
        world.release()
        saved = world.save()
        ways = []
        for _ in range(2):
            world.restore(saved)
            world.run(0.05, np.array([15.0, 0.0, 0.0]))
            ways.append(world.part_pose())
        world.forget(saved)
    # Bullet keeps its state in single precision in part
    assert ways[1] == pytest.approx(ways[0], abs=1e-6)


def test_the_part_has_its_inertia(
    name: str, hand: HandDescription, make_box: Callable[..., Part]
) -> None:
    """Moments of a box by its formula; a pose that goes in comes out, in the part's own frame."""
    part = make_box(0.02, 0.04, 0.06)
    moments, axes = inertia_of(part)
    lengths = np.array([0.02, 0.04, 0.06]) ** 2 / 12.0
    assert sorted(moments) == pytest.approx(sorted(lengths.sum() - lengths), rel=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    T = transform(axes, np.array([0.1, 0.2, 1.0]))
    with far_away(name, hand, part, 0.1) as engine:
        engine.place(T, np.zeros(hand.n_joints))
        assert inverse(T) @ engine.part_pose() == pytest.approx(np.eye(4), abs=1e-6)
