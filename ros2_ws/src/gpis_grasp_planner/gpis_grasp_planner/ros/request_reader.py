"""Reads all requests of services that have come, at once, and hands them to threads.

rclpy's executor takes one request of a service in each of its rounds, and the middleware's default
history keeps ten: of thirty calls at once twenty would be overwritten before anybody saw them. Its
rounds cost milliseconds of Python each, too, in a node with as many entities as this one. So the
services have a thread with a wait set of its own, and the executor does not see them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy
from rclpy.service import Service

from gpis_grasp_planner.ros.text import printable

# Nothing is overwritten: a writer that is too fast waits.
SERVICE_QOS = QoSProfile(
    history=QoSHistoryPolicy.KEEP_ALL,
    reliability=QoSReliabilityPolicy.RELIABLE,
    durability=QoSDurabilityPolicy.VOLATILE,
)
_FOR_EVER_NS = -1

# What is left to do of an answer, for a thread.
Work = Callable[[], None]


def later(answer: Callable[[Any, Any], None]) -> Callable[[Any, Any], Work]:
    """For :meth:`RequestReader.offer`: all of the answer is made by a thread."""
    return lambda request, response: partial(answer, request, response)


class _LeftAlone(CallbackGroup):
    """A group whose members the executor does not touch."""

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002
        return False

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ARG002
        return False

    def ending_execution(self, entity: Any) -> None:
        pass


@dataclass(frozen=True)
class _Offer:
    """A service and what begins its answers."""

    kind: Any
    service: Service
    begin: Callable[[Any, Any], Work | None]


class RequestReader:
    """Services whose requests are answered by threads, begun in the order in which they came.

    Parameters
    ----------
    node : Node
    threads : ThreadPoolExecutor
    """

    def __init__(self, node: Node, threads: ThreadPoolExecutor) -> None:
        self._node = node
        self._threads = threads
        self._offers: list[_Offer] = []
        self._group = _LeftAlone()
        self._ending = GuardCondition(None, None, node.context)
        self._thread = threading.Thread(target=self._read, name="request-reader", daemon=True)

    def offer(self, kind: Any, name: str, begin: Callable[[Any, Any], Work | None]) -> None:
        """Offer a service; before :meth:`start`.

        Parameters
        ----------
        kind : type
            Of the service.
        name : str
        begin : callable
            Called with a request and a response as soon as the request was read. It either fills in
            the response at once (the requests behind it wait for that) and returns None, or
            returns what a thread has to do to fill it in.
        """
        service = self._node.create_service(
            kind, name, lambda _request, response: response,
            qos_profile=SERVICE_QOS, callback_group=self._group,
        )  # fmt: skip
        self._offers.append(_Offer(kind, service, begin))

    def start(self) -> None:
        """Begin to read."""
        self._node.context.on_shutdown(self._end)  # it does not wake who waits
        self._thread.start()

    def close(self) -> None:
        """Read no more; what was read is answered all the same. Idempotent.

        The services go with the node, or by whoever destroys them.
        """
        if self._thread.is_alive():
            self._end()
            self._thread.join()
        self._ending.destroy()

    def _end(self) -> None:
        with suppress(rclpy_implementation.InvalidHandle):
            self._ending.trigger()

    def _read(self) -> None:
        """Read until :meth:`close`, or until the context is gone."""
        context = self._node.context
        with ExitStack() as in_use:
            for entity in (self._ending, *(offer.service for offer in self._offers), context):
                in_use.enter_context(entity.handle)
            waited = rclpy_implementation.WaitSet(0, 1, 0, 0, len(self._offers), 0, context.handle)
            while context.ok():
                waited.clear_entities()
                waited.add_guard_condition(self._ending.handle)
                for offer in self._offers:
                    waited.add_service(offer.service.handle)
                try:
                    waited.wait(_FOR_EVER_NS)
                except rclpy_implementation.RCLError:
                    if context.ok():
                        raise
                    return
                if waited.get_ready_entities("guard_condition"):
                    return
                for offer in self._offers:
                    self._take(offer)

    def _take(self, offer: _Offer) -> None:
        """Hand over all requests of a service that have come."""
        take, kind = offer.service.handle.service_take_request, offer.kind.Request
        while True:
            try:
                request, header = take(kind)
            except Exception as error:  # what does not fit the type: the others are still read
                self._warn("A request was not read", error)
                return
            if header is None:
                return
            self._answer(partial(self._begin, offer, request, header))

    def _begin(self, offer: _Offer, request: Any, header: Any) -> None:
        response = offer.kind.Response()
        work = offer.begin(request, response)
        send = partial(offer.service.send_response, response, header)
        if work is None:
            send()
        else:
            self._threads.submit(self._answer, work, send)

    def _answer(self, *steps: Work) -> None:
        try:
            for step in steps:
                step()
        except Exception as error:  # the client went away, or the node ends
            self._warn("An answer was not sent", error)

    def _warn(self, what: str, error: Exception) -> None:
        self._node.get_logger().warning(f"{what}: {printable(repr(error), 200)}")
