"""What a file says of an arm, and how a wrong one is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpis_grasp_planner.arm.description import load_arm
from gpis_grasp_planner.errors import RequestError


def test_a_file_says_where_a_shipped_arm_stands(tmp_path: Path) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(
        "arm: six_axis\n"
        "base: {position: [0.5, 0.0, 0.1], quat_xyzw: [0.0, 0.0, 1.0, 0.0]}\n"
        "flange: {position: [0.0, 0.0, 0.05]}\n"
    )
    arm, shipped = load_arm(str(file)), load_arm("six_axis")
    np.testing.assert_allclose(arm.T_arm_base[:3, 3], [0.5, 0.0, 0.1])
    np.testing.assert_allclose(np.diag(arm.T_arm_base), [-1.0, -1.0, 1.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(arm.T_flange_palm[:3, 3], [0.0, 0.0, 0.05])
    np.testing.assert_array_equal(arm.chain.T_parent_joint, shipped.chain.T_parent_joint)
    assert arm.identity != shipped.identity
    assert load_arm(str(file)) is arm


def test_what_changed_on_the_disk_is_read_again(tmp_path: Path) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text("arm: six_axis\nbase: {position: [0.5, 0.0, 0.0]}\n")
    first = load_arm(str(file))
    file.write_text("arm: six_axis\nbase: {position: [0.25, 0.0, 0.0]}\n")
    second = load_arm(str(file))
    assert second.T_arm_base[0, 3] == 0.25
    assert second.identity != first.identity


def test_joints_and_limits_of_the_shipped_arms() -> None:
    six, seven = load_arm("six_axis"), load_arm("seven_axis")
    assert six.redundant_joint is None
    assert seven.redundant_joint == 2
    np.testing.assert_allclose(
        np.rad2deg(six.chain.joint_upper), [360, 360, 180, 360, 360, 360], atol=1e-8
    )
    np.testing.assert_allclose(
        np.rad2deg(seven.chain.joint_upper), [170, 120, 170, 120, 170, 120, 175], atol=1e-8
    )
    for arm in (six, seven):
        np.testing.assert_array_equal(arm.chain.joint_lower, -arm.chain.joint_upper)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("arm: nine_axis\n", "names the arm 'nine_axis'"),
        ("arm: six_axis\nbasis: {}\n", "unknown fields basis"),
        ("arm: six_axis\nbase: {position: [0, 0]}\n", "3 numbers of 'position'"),
        ("arm: six_axis\nbase: {quat_xyzw: [0, 0, 0, 2]}\n", "has the length 2"),
        ("arm: six_axis\nbase: {rpy: [0, 0, 0]}\n", "no field rpy"),
        ("flange_link: flange\n", "'urdf' is missing"),
        ("urdf: absent.urdf\nflange_link: flange\n", "Cannot read the arm's URDF"),
        ("arm: six_axis\nflange_link: tool\n", "has no link 'tool'"),
        ("arm: six_axis\nredundant_joint: elbow\n", "does not describe an arm"),
        ("- 1\n", "holds no names and values"),
        ("arm: [", "Cannot read the arm"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "arm.yaml"
    file.write_text(text)
    with pytest.raises(RequestError, match=says):
        load_arm(str(file))


def test_an_unknown_arm_is_refused_with_those_there_are() -> None:
    with pytest.raises(RequestError, match="known are seven_axis, six_axis"):
        load_arm("five_axis")
    with pytest.raises(RequestError, match="Cannot read the arm"):
        load_arm("absent.yaml")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('type="revolute"', 'type="prismatic"', "is 'prismatic'"),
        ("<cylinder", "<mesh", "has a collision shape 'mesh'"),
        ('radius="0.075"', 'radius="-1"', "sizes are positive"),
        ('lower="-6.28318530718"', 'lower="7"', "lower and an upper one"),
    ],
)
def test_a_wrong_urdf_is_refused(tmp_path: Path, old: str, new: str, says: str) -> None:
    import gpis_grasp_planner.arm.description as module

    urdf = Path(module.__file__).parent / "models/six_axis/six_axis.urdf"
    text = urdf.read_text()
    assert old in text
    (tmp_path / "six.urdf").write_text(text.replace(old, new))
    (tmp_path / "arm.yaml").write_text("urdf: six.urdf\nflange_link: flange\n")
    with pytest.raises(RequestError, match=says):
        load_arm(str(tmp_path / "arm.yaml"))
