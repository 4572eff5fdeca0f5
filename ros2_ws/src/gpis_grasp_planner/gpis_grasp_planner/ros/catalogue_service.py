"""The services list_meshes and plan_grasps_batch: what there is, and several parts at once."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import Vector3
from rclpy.node import Node

from gpis_grasp_msgs.msg import MeshInfo, PartGrasps
from gpis_grasp_msgs.srv import ListMeshes, PlanGrasp, PlanGraspBatch
from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.ros.answering import GraspAnswering
from gpis_grasp_planner.ros.call import Call
from gpis_grasp_planner.ros.client_watch import watch_clients
from gpis_grasp_planner.ros.plan_source import PlanSource
from gpis_grasp_planner.ros.pose_source import PoseSource
from gpis_grasp_planner.ros.request_reader import RequestReader, later
from gpis_grasp_planner.ros.text import printable

LIST_SERVICE = "list_meshes"
BATCH_SERVICE = "plan_grasps_batch"


class CatalogueServices:
    """Offers both services.

    Parameters
    ----------
    node : Node
    plans : PlanSource
    poses : PoseSource
    answering : GraspAnswering
    requests : RequestReader
        As of `PlanGraspService`.
    """

    def __init__(
        self,
        node: Node,
        plans: PlanSource,
        poses: PoseSource,
        answering: GraspAnswering,
        requests: RequestReader,
    ) -> None:
        self._plans = plans
        self._poses = poses
        self._answering = answering
        # Of each its own: a batch is worked off for those who wait for one.
        self._list_watch = watch_clients(node, LIST_SERVICE)
        self._batch_watch = watch_clients(node, BATCH_SERVICE)
        requests.offer(ListMeshes, LIST_SERVICE, later(self._list))
        requests.offer(PlanGraspBatch, BATCH_SERVICE, later(self._plan_batch))

    def _list(self, request: Any, response: Any) -> None:
        call = Call()
        try:
            ids, refused = self._plans.listed()
        except GraspPlannerError as error:
            response.message = error.message
            return
        with self._list_watch.watched(call):
            entries = [
                self._info(mesh_id, call, measure=request.measure)
                for mesh_id in ids
                if not call.cancelled
            ]
        usable = [entry for entry in entries if entry.usable]
        response.meshes = [
            *usable,
            *(entry for entry in entries if not entry.usable),
            *(MeshInfo(file=printable(f, 200), reason=printable(r, 300)) for f, r in refused),
        ]
        measured = sum(entry.measured for entry in usable)
        response.message = (
            f"{len(usable)} meshes, {measured} of them measured; "
            f"{len(response.meshes) - len(usable)} files cannot be offered."
        )

    def _info(self, mesh_id: str, call: Call, *, measure: bool) -> MeshInfo:
        info = MeshInfo(mesh_id=mesh_id, usable=True, n_plans=self._plans.cache.count(mesh_id))
        try:
            facts = self._plans.facts(mesh_id, call, measure=measure)
        except GraspPlannerError as error:
            info.usable, info.reason = error.code >= 300, printable(error.message, 300)
            return info
        if facts is not None:
            info.measured, info.mass = True, facts.mass
            info.size = Vector3(x=facts.size[0], y=facts.size[1], z=facts.size[2])
        return info

    def _plan_batch(self, request: Any, response: Any) -> None:
        call = Call()
        mesh_ids = list(request.mesh_ids) or self._poses.parts()
        with self._batch_watch.watched(call):
            answers = [
                self._plan_one(request, mesh_id, call) for mesh_id in mesh_ids if not call.cancelled
            ]
        response.parts = sorted(answers, key=graspability, reverse=True)
        found = sum(part.success for part in answers)
        response.message = (
            f"Grasps for {found} of {len(answers)} parts."
            if answers
            else "No part has a pose estimate by name. Publish part_poses, or name mesh_ids."
        )
        response.elapsed = call.elapsed_s

    def _plan_one(self, request: Any, mesh_id: str, call: Call) -> PartGrasps:
        answer = PlanGrasp.Response()
        one = PlanGrasp.Request(
            mesh_id=mesh_id,
            time_budget=request.time_budget,
            n_grasps=request.n_grasps,
            verification=request.verification,
            objective=request.objective,
            task=request.task,
            support_plane=request.support_plane,
            obstacles=request.obstacles,
            target_frame=request.target_frame,
        )
        self._answering.answer(one, answer, call, BATCH_SERVICE)
        return PartGrasps(
            mesh_id=mesh_id,
            success=answer.success,
            code=answer.code,
            message=answer.message,
            grasps=answer.grasps,
            notes=answer.notes,
        )


def graspability(part: PartGrasps) -> tuple[bool, bool, float, float]:
    """What a batch is sorted by: has a grasp, held in physics, likely to hold, epsilon."""
    if not part.grasps:
        return False, False, -1.0, -1.0
    best = part.grasps[0]
    return part.success, best.verification.held, best.hold_probability, best.epsilon
