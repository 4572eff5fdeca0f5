"""What is forgotten when the clock goes back: a simulation that begins anew, a recording in a loop.

Stamps of before would mix with those of now, and a part or a camera be where it was the last time.
"""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node

_BACK = Duration(nanoseconds=-1)


class TimeJumps:
    """Calls functions after the node's clock went back, or has become another.

    Parameters
    ----------
    node : Node
    forget : sequence of callable
    """

    def __init__(self, node: Node, *forget: Callable[[], None]) -> None:
        self._log, self._forget = node.get_logger(), forget
        threshold = JumpThreshold(min_forward=None, min_backward=_BACK, on_clock_change=True)
        self._handle = node.get_clock().create_jump_callback(threshold, post_callback=self._on_jump)

    def close(self) -> None:
        """Listen no more."""
        self._handle.unregister()

    def _on_jump(self, _jump: TimeJump) -> None:
        for forget in self._forget:
            forget()
        self._log.warning(
            "The clock went back, or is another one: pose estimates and moving transforms of "
            "before are forgotten."
        )
