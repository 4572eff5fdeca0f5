"""An executor that spins in a thread, and the way to run something in that thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

T = TypeVar("T")
SPIN_S = 0.2
CALL_S = 60.0  # a bound on a hang


class SpinningExecutor:
    """Spins nodes in a thread of its own until :meth:`end`.

    rclpy's action client notes what it has sent only after sending, without a lock: an answer that
    another thread reads in between is dropped ("Ignoring unexpected goal response"). An entity
    that is destroyed while another thread builds its wait set ends that thread. So goals are sent
    and entities destroyed by :meth:`run`, between two waits of the thread that spins.
    Services have a lock of their own: their calls may come from any thread.

    Parameters
    ----------
    nodes : Node
    context : Context, optional
        Of the nodes; the default one.
    """

    def __init__(self, *nodes: Node, context: Context | None = None) -> None:
        self._executor = SingleThreadedExecutor(context=context)
        for node in nodes:
            self._executor.add_node(node)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self) -> None:
        while not self._ended.is_set():
            self._executor.spin_once(timeout_sec=SPIN_S)

    def run(self, function: Callable[..., T], *arguments: Any) -> T:
        """What a function returns, or raises, in the thread that spins."""
        done = threading.Event()
        task = self._executor.create_task(function, *arguments)
        task.add_done_callback(lambda _: done.set())
        if not done.wait(CALL_S):
            raise TimeoutError(f"{function} did not return in {CALL_S:g} s")
        return task.result()

    def end(self) -> None:
        """Spin no more; the nodes stay."""
        self._ended.set()
        self._thread.join()
        self._executor.shutdown()
