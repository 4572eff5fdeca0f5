"""Forward kinematics against the given cases, which an independent program made."""

import json
from pathlib import Path

import numpy as np
import pytest

from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.drive import joints_from_motors
from gpis_grasp_planner.hand.kinematics import link_transforms, rotation_about

CASES = json.loads((Path(__file__).parents[1] / "data" / "barrett_fk_cases.json").read_text())
TIP, TIP_CENTER = np.array([0.050, 0.0095, 0.0]), np.array([0.048, -0.0002, 0.0])


def test_points_of_the_given_cases_agree_within_a_hundredth_of_a_millimetre():
    hand, cases = load_hand(), CASES["cases"]
    assert len(cases) == 20
    spread = [[case["spread"]] for case in cases]
    motor = [[case[f] for f in ("f1", "f2", "f3")] for case in cases]
    T_palm_link = link_transforms(hand, joints_from_motors(hand, spread, motor))
    for row, case in zip(T_palm_link, cases, strict=True):
        for number, finger in enumerate(hand.fingers, start=1):
            T = row[finger.distal_link]
            found = {
                "tip": T[:3, :3] @ TIP + T[:3, 3],
                "tip_centre": T[:3, :3] @ TIP_CENTER + T[:3, 3],
                "joint3": T[:3, 3],
            }
            for name, point in found.items():
                np.testing.assert_allclose(point, case[f"f{number}_{name}"], atol=1e-5)


def test_batch_equals_single_and_transforms_are_rigid():
    hand = load_hand()
    seed = 7
    print(f"seed {seed}")
    q = np.random.default_rng(seed).uniform(hand.joint_lower, hand.joint_upper, (25, 8))
    batch = link_transforms(hand, q)
    assert batch.shape == (25, 10, 4, 4)
    np.testing.assert_array_equal(batch[:, 0], np.tile(np.eye(4), (25, 1, 1)))
    for row, joints in zip(batch, q, strict=True):
        np.testing.assert_allclose(link_transforms(hand, joints)[0], row, atol=1e-15)
    R = batch[..., :3, :3]
    np.testing.assert_allclose(
        R @ np.swapaxes(R, -1, -2), np.tile(np.eye(3), (25, 10, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-12)


@pytest.mark.parametrize(
    ("spread_deg", "direction_f1", "direction_f2"),
    [(0, (0, -1), (0, -1)), (90, (-1, 0), (1, 0)), (180, (0, 1), (0, 1))],
)
def test_spread_turns_the_fingers_the_way_the_fact_sheet_says(
    spread_deg, direction_f1, direction_f2
):
    hand = load_hand()
    q = joints_from_motors(hand, np.radians([[spread_deg]]), np.zeros((1, 3)))
    T = link_transforms(hand, q)[0]
    for finger, wanted, axis_x in zip(
        hand.fingers[:2], (direction_f1, direction_f2), (-0.025, 0.025), strict=True
    ):
        np.testing.assert_allclose(T[finger.knuckle_link, :2, 0], wanted, atol=1e-10)
        np.testing.assert_allclose(T[finger.knuckle_link, :3, 3], [axis_x, 0.0, 0.0415], atol=1e-12)
    # F3 stays at +y, whatever the spread.
    np.testing.assert_allclose(T[hand.fingers[2].knuckle_link, :2, 0], (0, 1), atol=1e-10)


def test_third_fingers_tip_reaches_the_centre_line_at_85_5_degrees_167_mm_high():
    hand = load_hand()
    motor_deg = np.linspace(80.0, 90.0, 1001)
    q = joints_from_motors(hand, np.zeros((1001, 1)), np.tile(np.radians(motor_deg)[:, None], 3))
    T = link_transforms(hand, q)[:, hand.fingers[2].distal_link]
    (piece,) = hand.link_collision[hand.fingers[2].distal_link]
    vertices = np.einsum("bij,nj->bni", T[:, :3, :3], piece.vertices) + T[:, None, :3, 3]
    foremost = vertices[np.arange(1001), vertices[..., 1].argmin(axis=1)]  # F3 comes from +y
    at = int(np.argmin(np.abs(foremost[:, 1])))
    assert motor_deg[at] == pytest.approx(85.5, abs=0.1)
    assert 1000 * foremost[at, 2] == pytest.approx(167.0, abs=1.0)


def test_a_quarter_turn_about_z_takes_x_to_y():
    T = rotation_about(np.array([0.0, 0.0, 1.0]), np.array([np.pi / 2]))[0]
    np.testing.assert_allclose(T[:3, :3] @ (1, 0, 0), (0, 1, 0), atol=1e-15)
