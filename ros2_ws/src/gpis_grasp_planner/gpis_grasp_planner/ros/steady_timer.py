"""Timers by the steady clock: a simulation that is paused, or has not begun, does not stop them."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.callback_groups import CallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer


def steady_timer(
    node: Node, period_s: float, callback: Callable[[], None], group: CallbackGroup | None = None
) -> Timer:
    """A node's timer whose period is of real time, with ``use_sim_time`` as well.

    rclpy's own go by the node's clock: feedback, diagnostics and markers would wait for ``/clock``.
    """
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    return node.create_timer(period_s, callback, callback_group=group, clock=clock)
