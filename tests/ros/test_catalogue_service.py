"""The order of a batch, and batches whose client left."""

from __future__ import annotations

from typing import Any

from real_node import plain_node

from gpis_grasp_msgs.msg import Grasp, GraspVerification, PartGrasps
from gpis_grasp_msgs.srv import PlanGraspBatch
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.catalogue_service import BATCH_SERVICE, CatalogueServices, graspability


def part(name: str, *, held: bool = False, success: bool = True, **fields: Any) -> PartGrasps:
    grasp = Grasp(verification=GraspVerification(attempted=held, held=held), **fields)
    return PartGrasps(mesh_id=name, success=success, grasps=[grasp])


def test_the_most_graspable_comes_first() -> None:
    in_order = [
        part("held, likely", held=True, hold_probability=0.9, epsilon=0.1),
        part("held, less likely", held=True, hold_probability=0.2, epsilon=0.3),
        part("held", held=True, epsilon=0.2),
        part("good", epsilon=0.3),
        part("poor", epsilon=0.1),
        PartGrasps(mesh_id="nothing"),
    ]
    mixed = [in_order[k] for k in (3, 5, 0, 4, 2, 1)]
    found = sorted(mixed, key=graspability, reverse=True)
    assert [p.mesh_id for p in found] == [p.mesh_id for p in in_order]


def test_a_batch_whose_client_left_is_not_worked_off() -> None:
    begin: dict[str, Any] = {}
    planned: list[str] = []

    class Requests:
        """Keeps what is offered."""

        def offer(self, _kind: Any, name: str, begun: Any) -> None:
            begin[name] = begun

    class Answering:
        """While the second part is planned, the client leaves."""

        def answer(self, request: Any, _response: Any, call: Call, _name: str) -> None:
            planned.append(request.mesh_id)
            if len(planned) == 2:
                for count in (1, 0, 0):  # as the watch's timer looks
                    services._batch_watch.count_clients = lambda count=count: count
                    services._batch_watch.look()
                assert call.cancelled

    with plain_node("batch") as node:
        services = CatalogueServices(node, None, None, Answering(), Requests())  # type: ignore[arg-type]
        request = PlanGraspBatch.Request(mesh_ids=["one", "two", "three", "four"])
        response = PlanGraspBatch.Response()
        begin[BATCH_SERVICE](request, response)()
    assert planned == ["one", "two"]
