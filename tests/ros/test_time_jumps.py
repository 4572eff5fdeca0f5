"""What is forgotten when a simulated clock goes back, and what is not."""

from __future__ import annotations

from rclpy.clock import ClockType
from rclpy.node import Node
from rclpy.time import Time
from real_node import real_node

from gpis_grasp_planner.ros.time_jumps import TimeJumps

SIMULATED = "-p use_sim_time:=true"


def test_a_clock_that_goes_back_has_all_forgotten_and_one_that_goes_on_nothing() -> None:
    forgotten: list[str] = []
    with real_node(lambda context: Node("jumping", context=context), SIMULATED) as node:
        jumps = TimeJumps(
            node, lambda: forgotten.append("estimates"), lambda: forgotten.append("frames")
        )

        def set_clock(seconds: float) -> None:
            clock = node.get_clock()
            clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))

        for seconds in (1.0, 1.5, 1.5, 900.0):
            set_clock(seconds)
        assert forgotten == []
        set_clock(899.5)
        assert forgotten == ["estimates", "frames"]
        set_clock(0.1)
        assert len(forgotten) == 4
        jumps.close()
        set_clock(0.05)
        assert len(forgotten) == 4
