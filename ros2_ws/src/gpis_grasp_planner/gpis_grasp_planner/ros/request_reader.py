"""Reads all requests of a service that have come, at once, and hands them to threads of its own.

rclpy's executor takes one request of a service in each of its rounds, and the middleware's default
history keeps ten: of thirty calls at once twenty would be overwritten before anybody saw them.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.waitable import NumberOfEntities, Waitable

# Nothing is overwritten: a writer that is too fast waits.
SERVICE_QOS = QoSProfile(
    history=QoSHistoryPolicy.KEEP_ALL,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
)


class _LeftAlone(CallbackGroup):
    """A group whose members the executor does not touch."""

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002
        return False

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ARG002
        return False

    def ending_execution(self, entity: Any) -> None:
        pass


class RequestReader(Waitable):
    """A service whose requests are answered by threads, in the order in which they came.

    Parameters
    ----------
    node : Node
    kind : type
        Of the service.
    name : str
    answer : callable
        Takes a request and a response, and fills in the latter; must not raise.
    threads : ThreadPoolExecutor
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        name: str,
        answer: Callable[[Any, Any], None],
        threads: ThreadPoolExecutor,
    ) -> None:
        super().__init__(ReentrantCallbackGroup())
        self._kind = kind
        self._answer = answer
        self._threads = threads
        self._is_ready = False
        self._service = node.create_service(
            kind, name, lambda _request, response: response,
            qos_profile=SERVICE_QOS, callback_group=_LeftAlone(),
        )  # fmt: skip
        self._log = node.get_logger()
        self.callback_group.add_entity(self)
        node.add_waitable(self)

    def _work(self, request: Any, header: Any) -> None:
        response = self._kind.Response()
        try:
            self._answer(request, response)
            self._service.send_response(response, header)
        except Exception as error:  # the client went away, or the node ends
            self._log.warning(f"An answer was not sent: {error!r:.200}")

    # What rclpy's executor asks of a waitable.

    def is_ready(self, wait_set: Any) -> bool:
        """Whether a request has come."""
        handle = self._service.handle
        self._is_ready = handle.pointer in wait_set.get_ready_entities("service")
        return self._is_ready

    def take_data(self) -> list[tuple[Any, Any]]:
        """Take all requests that have come: pairs of a request and its header."""
        taken: list[tuple[Any, Any]] = []
        handle = self._service.handle
        with handle:
            while True:
                request, header = handle.service_take_request(self._kind.Request)
                if header is None:
                    return taken
                taken.append((request, header))

    async def execute(self, taken_data: list[tuple[Any, Any]]) -> None:
        """Hand the requests over."""
        for request, header in taken_data:
            self._threads.submit(self._work, request, header)

    def get_num_entities(self) -> NumberOfEntities:
        """One service."""
        return NumberOfEntities(num_services=1)

    def add_to_wait_set(self, wait_set: Any) -> None:
        """Wait for the service."""
        with self._service.handle:
            wait_set.add_service(self._service.handle)
