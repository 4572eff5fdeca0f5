"""The node as a managed one: whoever manages the cell says when it plans.

``configure`` reads the configuration and starts the planning process, ``activate`` brings topics,
services and the action up, ``deactivate`` takes them away and keeps the plans in memory,
``cleanup`` ends the planning process. Parameters can be set before ``configure``.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from queue import Queue
from typing import Any

from rclpy._rclpy_pybind11 import RCLError
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.ros.interfaces import Interfaces
from gpis_grasp_planner.ros.parameters import NodeParameters
from gpis_grasp_planner.ros.planner_node import NODE_NAME
from gpis_grasp_planner.ros.planning import Planning
from gpis_grasp_planner.ros.text import printable

ERRAND_LIMIT_S = 10.0


class Errand(Future[None]):
    """A function that another thread calls."""

    def __init__(self, function: Callable[[], None]) -> None:
        super().__init__()
        self._function = function

    def run(self) -> None:
        """Call it, unless nobody waits any more."""
        if not self.set_running_or_notify_cancel():
            return
        try:
            self._function()
        except Exception as error:
            self.set_exception(error)
        else:
            self.set_result(None)


class GraspPlannerLifecycleNode(LifecycleNode):
    """The grasp planner as a lifecycle node; `planner_node.spin` runs it."""

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        self.grasp_parameters = NodeParameters(self)
        self._planning: Planning | None = None
        self._interfaces: Interfaces | None = None
        self._errands: Queue[Errand] = Queue()
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._change_or_refuse
        self.get_logger().info("Unconfigured: waits for the transition 'configure'.")

    def _change_or_refuse(self, request: Any, response: Any) -> Any:
        """Answer a transition that is not of this state: rclpy would raise, and answer nothing."""
        try:
            return self._change_state(request, response)
        except RCLError:
            asked = request.transition.label or request.transition.id
            self.get_logger().warning(
                f"No transition {printable(asked, 60)} from the state "
                f"'{self._state_machine.current_state[1]}'."
            )
            response.success = False
            return response

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start the planning process; FAILURE where the configuration does not allow it."""
        try:
            self._planning = Planning(self, self.grasp_parameters)
        except GraspPlannerError as error:
            self.get_logger().error(f"Not configured: {printable(error, 1000)}")
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Bring topics, services and the action up; FAILURE where a parameter forbids it."""
        try:
            self._between_spins(self._make_interfaces)
        except GraspPlannerError as error:
            self.get_logger().error(f"Not activated: {printable(error, 1000)}")
            return TransitionCallbackReturn.FAILURE
        return super().on_activate(state)

    def _make_interfaces(self) -> None:
        assert self._planning is not None
        self._interfaces = Interfaces(self, self.grasp_parameters, self._planning)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take them away. Requests in work are answered SHUTTING_DOWN; plans stay in memory."""
        if self._interfaces is not None:
            if self._interfaces.answering.n_in_work and self._planning is not None:
                self._planning = self._planning.renewed()
            self._interfaces.wait_until_answered()
            self._between_spins(self._interfaces.destroy)
            self._interfaces = None
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End the planning process and forget the plans."""
        self.close()
        self._planning = None
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End all of it, from whatever state."""
        self.close()
        if self._interfaces is not None:
            self._between_spins(self._interfaces.destroy)
        self._planning = self._interfaces = None
        return super().on_shutdown(state)

    def between_spins(self) -> None:
        """Do what transitions ask for; called by the executor's thread while it waits for nothing.

        Entities that appear and go while rclpy's executor waits for them cost answers.
        """
        while not self._errands.empty():
            self._errands.get().run()

    def _between_spins(self, function: Callable[[], None]) -> None:
        """Have a function called there; its error is raised here."""
        errand = Errand(function)
        self._errands.put(errand)
        try:
            errand.result(ERRAND_LIMIT_S)
        finally:
            errand.cancel()  # what was not begun in time is not done later, in another state

    def close(self) -> None:
        """End the planning process and wait until all requests are answered."""
        if self._planning is not None:
            self._planning.close()
        if self._interfaces is not None:
            self._interfaces.close()
            self._interfaces.wait_until_answered()
