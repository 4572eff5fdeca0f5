"""Frames by time: chains, a moving camera on a static base, interpolation, and what has no path."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, PoseError
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw, inverse
from gpis_grasp_planner.ros import transform_tree
from gpis_grasp_planner.ros.transform_tree import TransformTree

S = 1_000_000_000
IDENTITY = np.array([0.0, 0.0, 0.0, 1.0])


def about_z(degrees: float) -> np.ndarray:
    half = math.radians(degrees) / 2.0
    return np.array([0.0, 0.0, math.sin(half), math.cos(half)])


def put(
    tree: TransformTree, parent: str, child: str, t_s: float, xyz: Any, q: Any, static: bool = False
) -> None:
    position = np.array(xyz, dtype=float)
    assert tree.add(parent, child, int(t_s * S), position, q, static=static) is None


@pytest.fixture
def cell() -> TransformTree:
    """A static base; an arm that turns 90 degrees and moves 1 m in a second; a camera on it."""
    tree = TransformTree()
    put(tree, "map", "base", 0.0, (2, 0, 0), about_z(90), static=True)
    put(tree, "base", "tool", 100.0, (0, 0, 0.5), IDENTITY)
    put(tree, "base", "tool", 101.0, (1, 0, 0.5), about_z(90))
    put(tree, "tool", "camera", 0.0, (0, 0, 0.1), IDENTITY, static=True)
    return tree


def test_a_moving_camera_is_where_it_was_at_the_stamp(cell: TransformTree) -> None:
    for share in (0.0, 0.25, 0.5, 1.0):
        T = cell.look_up("base", "camera", int((100.0 + share) * S), 0.0)
        expected = from_position_quat_xyzw([share, 0, 0.6], about_z(90 * share))
        np.testing.assert_allclose(T, expected, atol=1e-9)


def test_there_and_back_is_the_inverse_by_any_path(cell: TransformTree) -> None:
    put(cell, "map", "table", 0.0, (0, 3, 0.7), about_z(-30), static=True)
    stamp = int(100.4 * S)
    T = cell.look_up("camera", "table", stamp, 0.0)
    np.testing.assert_allclose(cell.look_up("table", "camera", stamp, 0.0), inverse(T), atol=1e-12)
    by_map = inverse(cell.look_up("map", "camera", stamp, 0.0)) @ cell.look_up(
        "map", "table", stamp, 0.0
    )
    np.testing.assert_allclose(T, by_map, atol=1e-12)
    np.testing.assert_allclose(cell.look_up("tool", "tool", stamp, 0.0), np.eye(4))


@pytest.mark.parametrize(("t_s", "side"), [(101.5, "newest"), (99.5, "oldest")])
def test_outside_the_known_times_the_tolerance_decides(
    cell: TransformTree, t_s: float, side: str
) -> None:
    stamp = int(t_s * S)
    end = 101.0 if side == "newest" else 100.0
    np.testing.assert_allclose(
        cell.look_up("base", "tool", stamp, 0.6), cell.look_up("base", "tool", int(end * S), 0.0)
    )
    words = rf"{side} transform of 'tool' .* 0.50 s .* 0.4 s"
    with pytest.raises(PoseError, match=words) as caught:
        cell.look_up("base", "tool", stamp, 0.4)
    assert caught.value.code == ErrorCode.TRANSFORM_STALE


def test_static_frames_hold_at_all_times(cell: TransformTree) -> None:
    np.testing.assert_allclose(
        cell.look_up("map", "base", 10**18, 0.0), from_position_quat_xyzw([2, 0, 0], about_z(90))
    )


def test_no_path_is_told_with_the_frames_that_nobody_knows(cell: TransformTree) -> None:
    put(cell, "other", "island", 0.0, (0, 0, 0), IDENTITY, static=True)
    for target, source, words in (
        ("base", "nowhere", "does not know 'nowhere'"),
        ("base", "island", "roots 'other' and 'map'"),
        ("no\nframe", "island", r"no\nframe"),
    ):
        with pytest.raises(PoseError) as caught:
            cell.look_up(target, source, 100 * S, 1.0)
        assert caught.value.code == ErrorCode.NO_TRANSFORM
        assert words in caught.value.message


def test_the_shorter_way_round_is_interpolated() -> None:
    tree = TransformTree()
    put(tree, "a", "b", 1.0, (0, 0, 0), about_z(-10))
    put(tree, "a", "b", 2.0, (0, 0, 0), -about_z(10))
    T = tree.look_up("a", "b", int(1.5 * S), 0.0)
    np.testing.assert_allclose(T, np.eye(4), atol=1e-9)


def test_what_comes_late_is_put_in_its_place_and_a_repeat_replaces() -> None:
    tree = TransformTree()
    for t_s, x in ((1.0, 0.0), (3.0, 2.0), (2.0, 10.0), (2.0, 1.0)):
        put(tree, "a", "b", t_s, (x, 0, 0), IDENTITY)
    for t_s in (1.0, 1.5, 2.0, 2.5, 3.0):
        T = tree.look_up("a", "b", int(t_s * S), 0.0)
        assert T[0, 3] == pytest.approx(t_s - 1.0)


def test_history_and_number_of_frames_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transform_tree, "MOST_FRAMES", 3)
    tree = TransformTree()
    for t_s in range(100):
        put(tree, "a", "b", float(t_s), (t_s, 0, 0), IDENTITY)
    with pytest.raises(PoseError, match="oldest"):
        tree.look_up("a", "b", 80 * S, 0.0)
    assert tree.look_up("a", "b", 95 * S, 0.0)[0, 3] == 95.0
    for name in "cd":
        put(tree, "a", name, 0.0, (0, 0, 0), IDENTITY)
    why = tree.add("a", "e", 0, np.zeros(3), IDENTITY, static=False)
    assert why is not None
    assert "3 frames" in why
    assert len(tree) == 3


@pytest.mark.parametrize(
    ("parent", "child", "xyz", "quat"),
    [
        ("a", "a", (0, 0, 0), (0, 0, 0, 1)),
        ("", "b", (0, 0, 0), (0, 0, 0, 1)),
        ("a", "b", (math.nan, 0, 0), (0, 0, 0, 1)),
        ("a", "b", (0, 0, 0), (0, 0, 0, 0)),
        ("a", "b", (0, 0, 0), (0, 0, math.inf, 1)),
    ],
)
def test_what_is_no_transform_is_left_out(parent: str, child: str, xyz: Any, quat: Any) -> None:
    tree = TransformTree()
    assert tree.add(parent, child, 0, np.array(xyz), np.array(quat), static=False) is not None
    assert len(tree) == 0


def test_a_circle_does_not_hang_and_a_new_parent_takes_over() -> None:
    tree = TransformTree()
    put(tree, "a", "b", 0.0, (1, 0, 0), IDENTITY, static=True)
    put(tree, "b", "a", 0.0, (1, 0, 0), IDENTITY, static=True)
    with pytest.raises(PoseError):
        tree.look_up("c", "a", 0, 0.0)
    put(tree, "c", "a", 0.0, (5, 0, 0), IDENTITY, static=True)
    assert tree.look_up("c", "b", 0, 0.0)[0, 3] == 6.0


def test_after_the_clock_went_back_nothing_of_before_is_mixed_in() -> None:
    tree = TransformTree()
    put(tree, "base", "table", 0.0, (0, 0, 1), IDENTITY, static=True)
    put(tree, "base", "camera", 100.0, (50, 0, 0), IDENTITY)
    put(tree, "base", "camera", 102.0, (50, 0, 0), IDENTITY)
    tree.forget_moving()
    with pytest.raises(PoseError) as caught:
        tree.look_up("base", "camera", int(101.0 * S), 10.0)
    assert caught.value.code == ErrorCode.NO_TRANSFORM
    put(tree, "base", "camera", 99.0, (1, 0, 0), IDENTITY)
    put(tree, "base", "camera", 101.5, (2, 0, 0), IDENTITY)
    T = tree.look_up("base", "camera", int(101.5 * S), 0.0)
    np.testing.assert_allclose(T[:3, 3], [2, 0, 0])
    np.testing.assert_allclose(tree.look_up("base", "table", 0, 0.0)[:3, 3], [0, 0, 1])


def test_a_publisher_whose_clock_went_back_is_heard_again() -> None:
    tree = TransformTree()
    put(tree, "base", "camera", 1000.0, (50, 0, 0), IDENTITY)
    for k in range(3):
        put(tree, "base", "camera", 1.0 + k, (k, 0, 0), IDENTITY)
    T = tree.look_up("base", "camera", int(1.5 * S), 0.0)
    np.testing.assert_allclose(T[:3, 3], [0.5, 0, 0])
