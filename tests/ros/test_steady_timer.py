"""A timer that goes on where the simulation's clock does not."""

from __future__ import annotations

import threading

from rclpy.clock import ClockType
from rclpy.node import Node
from real_node import real_node
from spinning_executor import SpinningExecutor

from gpis_grasp_planner.ros.interfaces import Interfaces
from gpis_grasp_planner.ros.parameters import NodeParameters
from gpis_grasp_planner.ros.planning import Planning
from gpis_grasp_planner.ros.steady_timer import steady_timer

SIMULATED = "-p use_sim_time:=true"
LIMIT_S = 30.0  # a bound on a hang


def test_it_fires_without_a_clock() -> None:
    with real_node(lambda context: Node("paused", context=context), SIMULATED) as node:
        fired = threading.Event()
        steady_timer(node, 0.01, fired.set)
        executor = SpinningExecutor(node, context=node.context)
        assert fired.wait(LIMIT_S)
        executor.end()


def test_no_timer_of_the_node_waits_for_the_simulation() -> None:
    with real_node(lambda context: Node("simulated", context=context), SIMULATED) as node:
        parameters = NodeParameters(node)
        planning = Planning(node, parameters)
        interfaces = Interfaces(node, parameters, planning)
        kinds = [timer.clock.clock_type for timer in node.timers]
        planning.close()
        interfaces.destroy()
    assert kinds
    assert set(kinds) == {ClockType.STEADY_TIME}
