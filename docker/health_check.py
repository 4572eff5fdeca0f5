"""Exit with 0 if the planner's service is offered within a few seconds, else with 1."""

from __future__ import annotations

import sys
import time

import rclpy
from rclpy.node import Node

SERVICE = "/plan_grasp"
PATIENCE_S = 6.0


def main() -> int:
    """Look for the service in the ROS graph."""
    rclpy.init()
    node = Node("gpis_health_check", enable_rosout=False, start_parameter_services=False)
    end = time.monotonic() + PATIENCE_S
    found = False
    while not found and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
        found = SERVICE in dict(node.get_service_names_and_types())
    node.destroy_node()
    rclpy.shutdown()
    return 0 if found else 1


if __name__ == "__main__":
    sys.exit(main())
