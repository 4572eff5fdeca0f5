"""An estimator that tells now one and now another of a part's equal poses, over real DDS."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from scipy.spatial.transform import Rotation

from gpis_grasp_msgs.srv import PlanGrasp
from gpis_grasp_planner.errors import ErrorCode

SIDE_M = 0.05
YAML = f"""
unit: m
symmetries: [{{axis: [0, 0, 1], order: 4, point: [{SIDE_M / 2}, {SIDE_M / 2}, 0]}}]
"""


@pytest.fixture(scope="module")
def node(
    start_node: Callable[..., Any], tools: Any, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Any]:
    folder = tmp_path_factory.mktemp("symmetric")
    (folder / "cube.stl").write_bytes(tools.stl(tools.box(SIDE_M)))
    (folder / "cube.yaml").write_text(YAML)
    (folder / "wrong.stl").write_bytes(tools.stl(tools.box(SIDE_M)))
    (folder / "wrong.yaml").write_text(YAML.replace("order: 4", "order: 6"))
    started = start_node({"mesh_directories": f"[{folder}]", "planning_grace_s": "60.0"})
    started.wait_ready()
    yield started
    assert started.end() == 0, started.text()


def turned(quarter: int) -> tuple[list[float], list[float]]:
    """Position and quaternion of the cube in its place, turned about its own middle."""
    R = Rotation.from_euler("z", 90 * quarter, degrees=True)
    middle = np.array([SIDE_M / 2, SIDE_M / 2, 0.0])
    lying = Rotation.from_rotvec([0.4, 0.2, -0.7])
    position = np.array([0.5, 0.1, 0.3]) + lying.apply(middle - R.apply(middle))
    return position.tolist(), (lying * R).as_quat().tolist()


def test_equal_poses_have_the_same_grasps(node: Any, client: Any, tools: Any) -> None:
    publisher = client.node.create_publisher(PoseStamped, "object_pose", 1)
    palms, cached = [], []
    for quarter in range(4):
        xyz, xyzw = turned(quarter)

        def answer(xyz: Any = xyz, xyzw: Any = xyzw) -> PlanGrasp.Response:
            publisher.publish(tools.stamped(client, 0.0, frame="cell", xyz=xyz, xyzw=xyzw))
            return client.call(PlanGrasp.Request(mesh_id="cube", time_budget=3.0))

        tools.wait(lambda answer=answer: answer().success, "a grasp", 60.0)
        response = answer()
        assert response.success, response.message
        cached.append(response.from_cache)
        palms.append([tools.matrix(grasp.palm_pose.pose) for grasp in response.grasps])
    client.in_executor(client.node.destroy_publisher, publisher)
    assert all(cached)
    for other in palms[1:]:
        np.testing.assert_allclose(other, palms[0], atol=1e-9)


def test_what_the_mesh_does_not_have_is_refused(node: Any, client: Any) -> None:
    response = client.plan("wrong")
    assert response.code == ErrorCode.MESH_SIDECAR_INVALID
    assert "turned by them it stands out of itself by" in response.message
