"""Whether anybody is left to hear the answer of a service."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rclpy.node import Node

from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.steady_timer import steady_timer

CLIENTS_PERIOD_S = 1.0


class ClientWatch:
    """Cancels calls that nobody is left to hear the answers of.

    The middleware does not say whose request one is, only how many clients there are, and it may
    learn of a client later than of its request. So a call is cancelled where clients were seen
    while it was in work, and then none in two looks.

    Parameters
    ----------
    count_clients : callable
        How many clients there are now.
    """

    def __init__(self, count_clients: Callable[[], int]) -> None:
        self.count_clients = count_clients
        self._lock = threading.Lock()
        self._seen: dict[Call, bool] = {}
        self._was_alone = False

    @contextmanager
    def watched(self, call: Call) -> Iterator[None]:
        """Watch a call while it is in work."""
        with self._lock:
            self._seen[call] = False
        try:
            yield
        finally:
            with self._lock:
                del self._seen[call]

    def look(self) -> None:
        """Count clients; for a timer."""
        with self._lock:
            if not self._seen:
                self._was_alone = False
                return
            alone = self.count_clients() == 0
            if not alone:
                self._seen = dict.fromkeys(self._seen, True)
            gone = [call for call, seen in self._seen.items() if seen and self._was_alone and alone]
            self._was_alone = alone
        for call in gone:
            call.cancel("The client went away before its answer.")


def watch_clients(node: Node, *services: str) -> ClientWatch:
    """A watch that looks every second whether one of these services has a client."""
    # Under the names they have after remapping, which counting does not do.
    names = [node.resolve_service_name(name) for name in services]
    watch = ClientWatch(lambda: sum(map(node.count_clients, names)))
    steady_timer(node, CLIENTS_PERIOD_S, watch.look)
    return watch
