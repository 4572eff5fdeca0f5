"""A node that plans on a point cloud of its catalogue."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from cloud_shapes import CENTER, sphere_points, xyz

from gpis_grasp_msgs.srv import ListMeshes
from gpis_grasp_planner.errors import ErrorCode


def test_a_cloud_is_a_part_of_the_catalogue_and_a_bad_one_is_refused(
    client: Any,
    tools: Any,
    start_node: Callable[..., Any],
    tmp_path: Path,
    rng: np.random.Generator,
) -> None:
    points, _ = sphere_points(rng, 2500, 0.001, cap=0.0)
    (tmp_path / "ball.xyz").write_bytes(xyz(points))
    eye = (CENTER + np.array([0.0, 0.0, 0.5])).tolist()
    (tmp_path / "ball.yaml").write_text(f"unit: m\nviewpoints: [{eye}]\n")
    (tmp_path / "few.xyz").write_bytes(xyz(points[:50]))
    node = start_node({"mesh_directories": f"[{tmp_path}]", "default_verification": "rank"})
    node.wait_ready()
    response = client.plan("ball", time_budget=15.0, n_grasps=5)
    assert response.success, response.message
    assert response.grasps
    assert any("Reconstructed from a cloud of 2500 points" in note for note in response.notes)
    refused = client.plan("few", time_budget=5.0)
    assert refused.code == ErrorCode.MESH_DEGENERATE
    assert "at least 100" in refused.message
    service = client.node.create_client(ListMeshes, "list_meshes")
    assert service.wait_for_service(60.0)
    future = service.call_async(ListMeshes.Request(measure=True))
    tools.wait(future.done, "list_meshes", 120.0)
    of = {info.mesh_id: info for info in future.result().meshes}
    assert of["ball"].usable
    assert 0.06 < of["ball"].size.z < 0.1
    assert not of["few"].usable
    assert node.end() == 0
