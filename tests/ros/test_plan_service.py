"""The service plan_grasp and its clients."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from real_node import plain_node, real_node

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.ros.plan_service import PlanGraspService


def test_clients_are_counted_under_the_names_after_remapping(tools: Any) -> None:
    class Requests:
        """Offers nothing."""

        def offer(self, *_: Any) -> None:
            pass

    def make(context: Any) -> Node:
        return Node("renamed", context=context, namespace="/cell")

    with real_node(make, "-r plan_grasp:=/line/plan") as node, plain_node("asking") as client:
        service = PlanGraspService(node, None, Requests())  # type: ignore[arg-type]
        client.create_client(PlanGrasp, "/line/plan")
        tools.wait(lambda: service._watch.count_clients() == 1, "the renamed one's client")
        client.create_client(PlanGrasp, "/cell/get_grasps")
        tools.wait(lambda: service._watch.count_clients() == 2, "the other one's")
