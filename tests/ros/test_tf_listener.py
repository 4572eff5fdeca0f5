"""Transforms heard over real DDS, waited for, and refused with the right code."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from real_node import plain_node
from tf2_msgs.msg import TFMessage

from gpis_grasp_planner.errors import ErrorCode, PoseError
from gpis_grasp_planner.ros.settings import NodeSettings
from gpis_grasp_planner.ros.tf_listener import DYNAMIC_QOS, STATIC_QOS, TfListener

NS = 1_000_000_000
SETTINGS = NodeSettings(tf_wait_s=10.0, tf_tolerance_s=0.1)


def transform(parent: str, child: str, x: float, stamp_s: float = 0.0) -> TransformStamped:
    made = TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    made.header.stamp.sec = int(stamp_s)
    made.header.stamp.nanosec = round(stamp_s % 1.0 * NS)
    made.transform.translation.x = x
    return made


@dataclass
class Heard:
    """A listener on a node that a thread spins, and another node that publishes."""

    listener: TfListener
    settings: NodeSettings
    talker: Node
    publishers: dict[bool, Any]

    def say(self, *transforms: TransformStamped, static: bool = False) -> None:
        self.publishers[static].publish(TFMessage(transforms=list(transforms)))


@pytest.fixture
def heard() -> Iterator[Heard]:
    with plain_node("talker") as talker, plain_node("listener", spins=True) as node:
        publishers = {
            False: talker.create_publisher(TFMessage, "/tf", DYNAMIC_QOS),
            True: talker.create_publisher(TFMessage, "/tf_static", STATIC_QOS),
        }
        made = Heard(TfListener(node, lambda: made.settings), SETTINGS, talker, publishers)
        deadline = time.monotonic() + 30.0
        heard_on = [s for s in node.subscriptions if s.topic_name in ("/tf", "/tf_static")]
        # What is sent best-effort before both ends know of each other is lost.
        while not (
            all(p.get_subscription_count() for p in publishers.values())
            and all(s.get_publisher_count() for s in heard_on)
        ):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        yield made


def test_a_chain_of_moving_and_static_frames_is_followed_both_ways(heard: Heard) -> None:
    heard.say(transform("base", "camera", 1.0, 10.0), transform("base", "camera", 3.0, 12.0))
    heard.say(transform("base", "table", 10.0), static=True)
    # Half way between two transforms, as the camera moves evenly.
    T = heard.listener.transform("table", "camera", 11 * NS)
    assert np.allclose(T[:3, 3], [2.0 - 10.0, 0.0, 0.0])
    assert np.allclose(T @ heard.listener.transform("camera", "table", 11 * NS), np.eye(4))


def test_frames_that_move_are_told_and_static_ones_are_not(heard: Heard) -> None:
    told: list[str] = []
    heard.listener.on_frame = told.append
    heard.say(transform("base", "table", 1.0), static=True)
    heard.listener.transform("base", "table", 0)
    heard.say(transform("base", "/cup", 1.0))
    heard.listener.transform("base", "cup", 0)
    heard.say(transform("base", "plate", 1.0))
    heard.listener.transform("base", "plate", 0)
    assert told[0] == "cup"
    assert "table" not in told


def test_a_static_frame_is_heard_by_whoever_comes_later(heard: Heard) -> None:
    heard.say(transform("base", "table", 0.5), static=True)
    with plain_node("late", spins=True) as node:
        late = TfListener(node, lambda: SETTINGS)
        assert late.transform("base", "table", 0)[0, 3] == 0.5


def test_a_transform_that_is_on_its_way_is_waited_for(heard: Heard) -> None:
    later = threading.Timer(0.3, heard.say, [transform("base", "camera", 2.0, 5.0)])
    later.start()
    assert heard.listener.transform("base", "camera", 5 * NS)[0, 3] == 2.0
    later.join()


def test_one_that_is_only_near_in_time_is_taken_after_the_wait_alone(heard: Heard) -> None:
    heard.say(transform("base", "camera", 2.0, 5.0))
    heard.listener.transform("base", "camera", 5 * NS)
    later = threading.Timer(0.3, heard.say, [transform("base", "camera", 4.0, 5.1)])
    later.start()
    between = 5 * NS + NS // 20
    assert heard.listener.transform("base", "camera", between)[0, 3] == pytest.approx(3.0)
    later.join()
    heard.settings = replace(SETTINGS, tf_wait_s=0.3)
    after = 5 * NS + 3 * NS // 20
    began = time.monotonic()
    assert heard.listener.transform("base", "camera", after)[0, 3] == 4.0
    assert time.monotonic() - began >= 0.3


@pytest.mark.parametrize(
    ("source", "stamp_s", "code"),
    [
        ("nowhere", 5.0, ErrorCode.NO_TRANSFORM),
        ("camera", 50.0, ErrorCode.TRANSFORM_STALE),
    ],
)
def test_what_does_not_come_is_refused_after_the_wait(
    heard: Heard, source: str, stamp_s: float, code: ErrorCode
) -> None:
    heard.say(transform("base", "camera", 2.0, 5.0))
    heard.listener.transform("base", "camera", 5 * NS)
    for wait_s in (0.0, 0.3):
        heard.settings = replace(SETTINGS, tf_wait_s=wait_s)
        began = time.monotonic()
        with pytest.raises(PoseError) as caught:
            heard.listener.transform("base", source, int(stamp_s) * NS)
        assert caught.value.code is code
        assert time.monotonic() - began >= wait_s


def test_the_tolerance_is_that_of_the_moment(heard: Heard) -> None:
    heard.say(transform("base", "camera", 2.0, 5.0))
    heard.listener.transform("base", "camera", 5 * NS)
    heard.settings = replace(SETTINGS, tf_wait_s=0.0)
    with pytest.raises(PoseError):
        heard.listener.transform("base", "camera", 6 * NS)
    heard.settings = replace(SETTINGS, tf_wait_s=0.0, tf_tolerance_s=2.0)
    assert heard.listener.transform("base", "camera", 6 * NS)[0, 3] == 2.0


def test_a_bad_transform_is_told_once_in_a_while_and_the_good_ones_are_taken(
    heard: Heard, capfd: pytest.CaptureFixture[str]
) -> None:
    bad = transform("base", "broken", float("nan"), 5.0)
    heard.say(bad, bad, bad, transform("base", "camera", 2.0, 5.0))
    assert heard.listener.transform("base", "camera", 5 * NS)[0, 3] == 2.0
    assert capfd.readouterr().err.count("On tf, ignored:") == 1
    heard.settings = replace(SETTINGS, tf_wait_s=0.0)
    with pytest.raises(PoseError):
        heard.listener.transform("base", "broken", 5 * NS)


def test_without_the_messages_of_tf_it_says_what_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "tf2_msgs.msg", None)
    with plain_node("listener") as node:
        before = len(list(node.subscriptions))
        listener = TfListener(node, lambda: SETTINGS)
        assert len(list(node.subscriptions)) == before
        with pytest.raises(PoseError, match="tf2_msgs is not installed") as caught:
            listener.transform("base", "camera\n", 0)
        assert caught.value.code is ErrorCode.NO_TRANSFORM
        assert caught.value.message.isprintable()
