"""What there is, what is known, and several parts at once, over real DDS."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PoseWithCovariance

from gpis_grasp_msgs.msg import PartPose, PartPoses
from gpis_grasp_msgs.srv import ListMeshes, PlanGrasp, PlanGraspBatch
from gpis_grasp_planner.errors import ErrorCode


def call(client: Any, tools: Any, kind: Any, name: str, request: Any) -> Any:
    service = client.node.create_client(kind, name)
    assert service.wait_for_service(60.0)
    future = service.call_async(request)
    tools.wait(future.done, name, 120.0)
    client.in_executor(client.node.destroy_client, service)
    return future.result()


def test_the_list_says_what_can_be_offered_and_why_not(
    client: Any, planned: PlanGrasp.Response, tools: Any
) -> None:
    quick = call(client, tools, ListMeshes, "list_meshes", ListMeshes.Request())
    of = {info.mesh_id: info for info in quick.meshes}
    assert of["mug"].usable
    assert of["mug"].n_plans >= 1
    assert not of["mug"].measured
    assert {info.file for info in quick.meshes if not info.mesh_id} == {"link.stl", "pipe.stl"}
    measured = call(client, tools, ListMeshes, "list_meshes", ListMeshes.Request(measure=True))
    of = {info.mesh_id: info for info in measured.meshes}
    assert of["mug"].measured
    assert of["mug"].mass > 0.0
    assert 0.05 < of["mug"].size.z < 0.2
    assert not of["nan"].usable
    assert of["nan"].reason
    assert not any("/" in info.reason for info in measured.meshes)


def test_what_is_known_is_answered_and_nothing_is_searched(
    client: Any, planned: PlanGrasp.Response, tools: Any
) -> None:
    known = call(client, tools, PlanGrasp, "get_grasps", tools.request("mug"))
    assert known.success
    assert len(known.grasps) == len(planned.grasps)
    unknown = call(client, tools, PlanGrasp, "get_grasps", tools.request("mug", seed=4711))
    assert unknown.code == ErrorCode.NOTHING_KNOWN
    assert unknown.evaluations == 0


def test_a_batch_is_of_all_parts_in_view(
    client: Any, planned: PlanGrasp.Response, tools: Any
) -> None:
    publisher = client.node.create_publisher(PartPoses, "part_poses", 1)

    def answer() -> Any:
        parts = []
        for mesh_id in ("mug", "sphere"):
            message = tools.stamped(client, 0.0, frame="tray")
            pose = PoseWithCovariance(pose=message.pose)
            parts.append(PartPose(header=message.header, mesh_id=mesh_id, pose=pose))
        publisher.publish(PartPoses(parts=parts))
        request = PlanGraspBatch.Request(time_budget=1.0, verification="none")
        return call(client, tools, PlanGraspBatch, "plan_grasps_batch", request)

    tools.wait(lambda: len(answer().parts) == 2, "the estimates", 60.0)
    batch = answer()
    assert {part.mesh_id for part in batch.parts} == {"mug", "sphere"}
    assert all(part.success for part in batch.parts), batch.message
    epsilons = [part.grasps[0].epsilon for part in batch.parts]
    assert epsilons == sorted(epsilons, reverse=True)
    client.in_executor(client.node.destroy_publisher, publisher)
