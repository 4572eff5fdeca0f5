"""A rclpy node with a context of its own, and a thread that spins it where a test wants that."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import rclpy
from rclpy.node import Node
from spinning_executor import SpinningExecutor

N = TypeVar("N", bound=Node)


@contextmanager
def real_node(make: Callable[[rclpy.Context], N], arguments: str = "") -> Iterator[N]:
    """A node that nobody spins; destroyed at the end.

    Parameters
    ----------
    make : callable
        Makes the node in a context.
    arguments : str
        As on the command line, after ``--ros-args``.
    """
    context = rclpy.Context()
    rclpy.init(context=context, args=["--ros-args", *arguments.split()])
    try:
        node = make(context)
        yield node
        node.destroy_node()
    finally:
        rclpy.try_shutdown(context=context)


@contextmanager
def plain_node(name: str, *, spins: bool = False) -> Iterator[Node]:
    """A node without anything; `spins` has a thread spin it."""
    with real_node(lambda context: Node(name, context=context)) as node:
        executor = SpinningExecutor(node, context=node.context) if spins else None
        try:
            yield node
        finally:
            if executor is not None:
                executor.end()
