"""From the frame whose pose an estimator tells to the frame of the part's mesh.

Estimators have model frames of their own, such as the middle of the box, and of a symmetric part
they tell one equal pose or another. What the part's YAML file says of both (`estimator_frame`,
`symmetries`) is applied to every estimate, and to no pose that a request carries.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

from gpis_grasp_planner.geometry.sidecar import Sidecar
from gpis_grasp_planner.geometry.transforms import inverse
from gpis_grasp_planner.ros.request_guard import ObjectPose
from gpis_grasp_planner.surroundings.covariance import covariance_moved

_MAX_PARTS = 1000


class EstimatorFrames:
    """What parts' YAML files say of their estimators' frames and of their symmetries.

    Parameters
    ----------
    sidecar : callable
        The sidecar of a mesh ID, read.
    version : callable
        Of a mesh ID, by its files: another text once one of them has changed.
    """

    def __init__(
        self, sidecar: Callable[[str], Sidecar], version: Callable[[str], str | None]
    ) -> None:
        self._sidecar, self._version = sidecar, version
        self._lock = threading.Lock()
        self._known: dict[str, tuple[str | None, Sidecar]] = {}

    def pose_of_mesh(self, mesh_id: str, estimate: ObjectPose) -> ObjectPose:
        """The pose of the mesh's frame, by an estimate of the estimator's.

        Raises
        ------
        GraspPlannerError
            Of the catalogue: for a part that is unknown, or whose YAML file is bad or written just
            now. A pose without what that says would be another one.
        """
        sidecar = self._of(mesh_id)
        if sidecar.T_mesh_estimator is None and sidecar.symmetry is None:
            return estimate
        T_world_mesh = estimate.T_world_object
        if sidecar.T_mesh_estimator is not None:
            T_world_mesh = T_world_mesh @ inverse(sidecar.T_mesh_estimator)
        if sidecar.symmetry is not None:
            T_world_mesh = sidecar.symmetry.chosen(T_world_mesh)
        covariance = estimate.covariance
        if covariance is not None:
            offset = T_world_mesh[:3, 3] - estimate.T_world_object[:3, 3]
            covariance = covariance_moved(covariance, offset)
        return replace(estimate, T_world_object=T_world_mesh, covariance=covariance)

    def _of(self, mesh_id: str) -> Sidecar:
        version = self._version(mesh_id)
        with self._lock:
            known = self._known.get(mesh_id)
        if known is not None and known[0] == version:
            return known[1]
        sidecar = self._sidecar(mesh_id)
        with self._lock:
            if len(self._known) >= _MAX_PARTS:
                self._known.clear()
            self._known[mesh_id] = version, sidecar
        return sidecar
