"""A hand that is written here: a thumb of two links and two fingers of three, a pre-shape of two.

Left and right turn about the palm by one motor of the pre-shape, the thumb slides along the palm by
the other; both begin below 0.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from hand_models import box_link, held_in_both_engines, joint_about
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.grasp.open_hand import open_postures
from gpis_grasp_planner.hand.checks import faults_of
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.drive import (
    joints_from_motors,
    motors_from_joints,
    reachable,
    row_ends,
    touch_motors,
)
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.scene.bullet_evaluator import BulletEvaluator
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.verification.settings import VerificationSettings

LENGTHS = {"thumb": (0.045, 0.035), "left": (0.04, 0.03, 0.025), "right": (0.04, 0.03, 0.025)}
UPPER = {"thumb": (1.6, 1.2), "left": (1.5, 1.2, 1.0), "right": (1.5, 1.2, 1.0)}
PLACES = {"thumb": (32, 0, 0), "left": (-32, 28, 180), "right": (-32, -28, 180)}
# Thumb: both joints alike until the first is held. Left and right: the last follows the middle one.
ROWS = {"thumb": [[1, 0.75], [0, 1]], "left": [[1, 0.8, 0.6], [0, 1, 0.8], [0, 0, 1]]}
ROWS["right"] = ROWS["left"]
FAN_RAD, SLIDE_M = np.radians(40.0), 0.012


def write_hand(folder: Path) -> Path:
    """The URDF and the YAML file; fingers lean out by 0.4 rad and close towards the other side."""
    parts = [box_link("palm", (0.1, 0.09, 0.05), (0.0, 0.0, 0.025))]
    fingers = []
    for finger, (x, y, turn) in PLACES.items():
        base = f"{finger}_base"
        kind, axis = ("prismatic", "0 1 0") if finger == "thumb" else ("revolute", "0 0 1")
        end = SLIDE_M if finger == "thumb" else FAN_RAD
        parts += [
            box_link(base, (0.02, 0.016, 0.01), (0.0, 0.0, 0.0)),
            joint_about(
                base, "palm", f'xyz="{x / 1000} {y / 1000} 0.055"', (-end, end), kind, axis
            ),
        ]
        parent = base
        # x of a link's frame along the link, y out of its pad, z along the joint
        origin = f'xyz="0 0 0.006" rpy="1.5707963 -1.1707963 {np.radians(turn)}"'
        for number, (length, upper) in enumerate(zip(LENGTHS[finger], UPPER[finger], strict=True)):
            link = f"{finger}{number}"
            parts += [
                box_link(link, (length, 0.014, 0.018), (0.5 * length, 0.0, 0.0)),
                joint_about(link, parent, origin, (0.0, upper)),
            ]
            parent, origin = link, f'xyz="{length} 0 0"'
        fingers.append(
            {
                "name": finger,
                "joints": [f"{finger}{k}_joint" for k in range(len(LENGTHS[finger]))],
                "closing_rows": ROWS[finger],
                "tip_point_mm": [900.0 * LENGTHS[finger][-1], 7.0, 0.0],
            }
        )
    (folder / "mine.urdf").write_text(f'<robot name="mine">{"".join(parts)}</robot>')
    description = {
        "name": "mine",
        "urdf": "mine.urdf",
        "palm_link": "palm",
        "palm_friction_links": ["palm", "thumb_base", "left_base", "right_base"],
        "preshape": [
            {
                "name": "fan",
                "lower_deg": -20.0,
                "upper_deg": float(np.degrees(FAN_RAD)),
                "full_travel_s": 0.5,
                "joints": {"left_base_joint": 1, "right_base_joint": -1},
            },
            {
                "name": "slide",
                "lower_mm": -1000.0 * SLIDE_M,
                "upper_mm": 1000.0 * SLIDE_M,
                "full_travel_s": 0.5,
                "joints": {"thumb_base_joint": 1},
            },
        ],
        "fingers": fingers,
        "drive": {
            "motor_names": list(PLACES),
            "motor_upper_deg": [float(np.degrees(UPPER[f][0])) for f in PLACES],
            "full_travel_s": [1.0] * 3,
            "independent": True,
            "breakaway_torque": 0.3,
            "tip_force_n": 10,
        },
    }
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(description, sort_keys=False))
    return path


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return write_hand(tmp_path_factory.mktemp("hand"))


@pytest.fixture(scope="module")
def planner(path):
    return GraspPlanner(PlannerSettings(hand=HandSettings(model=str(path))))


@pytest.fixture(scope="module")
def drawn(planner):
    """Pre-shapes, motors and postures all over their ranges, some links held on the way."""
    hand, rng = planner.hand, np.random.default_rng(8)
    n = 300
    preshape = rng.uniform(hand.preshape.lower, hand.preshape.upper, (n, 2))
    motors = rng.uniform(0.0, 1.0, (n, 3)) * hand.drive.motor_upper
    held = rng.uniform(0.0, 1.5, (n, 3, 2))
    held[rng.random(held.shape) < 0.4] = np.inf
    return hand, preshape, motors, joints_from_motors(hand, preshape, motors, held)


def test_it_is_read_without_a_fault(planner):
    hand = planner.hand
    assert faults_of(hand) == []
    assert hand.preshape.names == ("fan", "slide")
    np.testing.assert_allclose(hand.preshape.unit, [1.0, 0.05])
    assert [len(finger.links) for finger in hand.fingers] == [2, 3, 3]
    np.testing.assert_array_equal(hand.first_joint, [1, 0, 0])
    # Places of contact are found: on every finger's link the side that moves ahead, and the palm.
    wanted = hand.desired_contacts
    assert set(wanted.links) == {0, *(link for f in hand.fingers for link in f.links)}
    np.testing.assert_allclose(wanted.normals[wanted.links > 0, 1], 1.0, atol=1e-9)
    # Every motor is a degree of freedom of its own, over all of its way.
    space = hand.eigengrasps
    for sign, end in ((-1.0, hand.motor_lower), (1.0, hand.motor_upper)):
        found = space.origin + sign * space.amplitude_limit * np.ones(5) @ space.directions
        np.testing.assert_allclose(found, end, atol=1e-12)


def test_free_fingers_follow_their_own_first_rows(planner):
    hand = planner.hand
    joints = joints_from_motors(hand, [[0.3, -0.01]], [[0.8, 0.5, 0.4]])[0]
    at = dict(zip(hand.joint_names, joints, strict=True))
    assert [at["left_base_joint"], at["right_base_joint"]] == pytest.approx([0.3, -0.3])
    assert at["thumb_base_joint"] == pytest.approx(-0.01)
    assert [at["thumb0_joint"], at["thumb1_joint"]] == pytest.approx([0.8, 0.6])
    assert [at[f"left{k}_joint"] for k in range(3)] == pytest.approx([0.5, 0.4, 0.3])
    assert [at[f"right{k}_joint"] for k in range(3)] == pytest.approx([0.4, 0.32, 0.24])


def test_motors_and_joints_are_inverse_whatever_is_held(drawn):
    hand, preshape, motors, joints = drawn
    inside = (joints < hand.joint_upper - 1e-9).all(axis=1)  # else the clip has changed them
    assert inside.sum() > 80
    back_shape, back = motors_from_joints(hand, joints[inside])
    np.testing.assert_allclose(back_shape, preshape[inside], atol=1e-12)
    np.testing.assert_allclose(back, motors[inside], atol=1e-12)
    assert reachable(hand, joints[inside]).all()
    # The short finger's coupling counts as well.
    first, second = hand.fingers[0].joints
    coupled = inside & (np.abs(joints[:, second] - 0.75 * joints[:, first]) < 1e-9)
    assert coupled.sum() > 20
    behind = joints[coupled].copy()
    behind[:, second] -= 0.02
    assert not reachable(hand, behind).any()


def test_the_first_contact_of_a_short_finger_is_where_its_own_first_link_was_held(planner):
    hand = planner.hand
    held = np.full((1, 3, 2), np.inf)
    held[0, 0, 1] = 0.4  # the thumb's first link; what it does not have comes before it
    joints = joints_from_motors(hand, np.zeros((1, 2)), [[0.6, 0.2, 0.2]], held)
    thumb = hand.fingers[0]
    assert joints[0, list(thumb.joints)] == pytest.approx([0.4, 0.3 + 0.2 * 1.75])
    assert row_ends(hand, joints)[0, 0] == pytest.approx([0.0, 0.4])
    assert touch_motors(hand, joints)[0, 0] == pytest.approx(0.4)


def test_the_search_and_pybullet_close_it_alike(planner, catalogue):
    part, hand = catalogue.load("bracket"), planner.hand
    settings = planner.settings.scene
    compiled = CompiledEvaluator(hand, part, Friction(0.6, 0.6), settings)
    seed = 4
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    n = 40
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Rotation.random(n, random_state=rng).as_matrix()
    T[:, :3, 3] = part.center_of_mass - T[:, :3, 2] * 0.09
    preshape = rng.uniform(hand.preshape.lower, hand.preshape.upper, (n, 2))
    T, free = compiled.clear_palm(T, -T[:, :3, 2], preshape, np.zeros(n))
    found = compiled.attempt(T[free], preshape[free])
    start = open_postures(hand, preshape[free])
    moved = list(hand.preshape.joints)
    np.testing.assert_allclose(found.joints[:, moved], start[:, moved], atol=1e-15)
    with BulletEvaluator(hand, part, Friction(0.6, 0.6), settings) as bullet:
        other = bullet.attempt(T[free], preshape[free])
    assert (found.status == other.status).mean() >= 0.9
    both = (found.status == AttemptStatus.GRASPED) & (other.status == AttemptStatus.GRASPED)
    assert both.sum() >= 5
    apart = np.abs(found.joints - other.joints)[both].max(axis=1)
    print(both.sum(), "of", n, apart)
    assert np.median(apart) < 5e-3


def test_it_plans_uses_its_pre_shape_and_is_tried_in_both_engines(planner, catalogue):
    part = catalogue.load("sphere")
    request = PlanRequest(
        time_budget_s=600.0,
        max_evaluations=800,
        n_grasps=6,
        friction=Friction(0.6, 0.6),
        verification="none",
        seed=2,
    )
    result = planner.answer(part, request).result
    assert len(result.grasps) >= 4
    for grasp in result.grasps:
        assert grasp.epsilon > 0.0
        assert reachable(planner.hand, grasp.joints).all()
    shapes = planner.hand.preshape.of(np.stack([grasp.joints for grasp in result.grasps]))
    ends = planner.hand.preshape.lower, planner.hand.preshape.upper
    print(shapes)
    assert ((shapes >= ends[0] - 1e-9) & (shapes <= ends[1] + 1e-9)).all()
    assert ((shapes > ends[0] + 1e-3) & (shapes < ends[1] - 1e-3)).all(axis=1).any()
    held_in_both_engines(part, planner.hand, result.grasps)


def test_a_trial_sets_the_pre_shape_that_the_grasp_has(planner, catalogue):
    """Link poses of MuJoCo's model at a pre-shape are those of the kinematics."""
    from gpis_grasp_planner.verification.mujoco.engine import MujocoEngine

    part, hand = catalogue.load("bracket"), planner.hand
    joints = joints_from_motors(hand, [[0.5, 0.01]], [[0.4, 0.3, 0.2]])[0]
    with MujocoEngine(hand, part, VerificationSettings()) as engine:
        engine.take_pieces([part.mesh.vertices])
        engine.place(np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1.0], [0, 0, 0, 1]]), joints)
        expected = link_transforms(hand, joints[None])[0]
        found = np.stack([engine.data.xpos[body] for body in engine._bodies])
    distance, _ = cKDTree(expected[:, :3, 3]).query(found)
    np.testing.assert_allclose(distance, 0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d["preshape"][1]["joints"].update(thumb0_joint=1), "by a finger's closing"),
        (lambda d: d["preshape"][1]["joints"].update(nowhere=1), "'nowhere' that the URDF"),
        (lambda d: d["preshape"][0]["joints"].update(thumb_base_joint=1), "turn and joints that"),
        (lambda d: d["preshape"].append(dict(d["preshape"][0], name="again")), "apart"),
        (lambda d: d["preshape"][0].update(lower_deg=50.0), "give each a range"),
        (lambda d: d["fingers"][0].pop("closing_rows"), "Fingers of 2 links need"),
        (lambda d: d["fingers"][0].update(closing_rows=ROWS["left"]), "a finger of 2 links needs"),
        (lambda d: d["fingers"][0].update(spread_joint="x"), "under 'preshape' now"),
        (lambda d: d["drive"]["motor_names"].insert(0, "fan"), "one for each finger"),
        (
            lambda d: d.update(
                eigengrasps={"origin": [0.0] * 4, "directions": [[1.0] * 4], "amplitude_limit": 1}
            ),
            "give each 5 numbers",
        ),
    ],
)
def test_descriptions_that_contradict_themselves_are_refused(path, tmp_path, change, said):
    data = yaml.safe_load(path.read_text())
    change(data)
    (tmp_path / "mine.urdf").write_text(path.with_suffix(".urdf").read_text())
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(RequestError, match=said):
        load_hand(str(tmp_path / "mine.yaml"))
