"""Estimates of a frame that is not the mesh's, by quaternions and by samples."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue
from gpis_grasp_planner.geometry.sidecar import Sidecar, parse_sidecar
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.ros.estimator_frames import EstimatorFrames
from gpis_grasp_planner.ros.mesh_source import fingerprint
from gpis_grasp_planner.ros.request_guard import ObjectPose

TEXT = """
unit: mm
estimator_frame:
  position: [0.01, -0.02, 0.03]
  orientation_xyzw: [0.0, 0.0, 0.7071068, 0.7071068]
"""
SIDECAR = parse_sidecar(TEXT.encode(), "part.yaml")


def estimate(T: np.ndarray, covariance: np.ndarray | None = None) -> ObjectPose:
    return ObjectPose(T, "camera", 5, covariance, ("a note",))


def test_a_point_of_the_part_is_where_the_estimator_says(rng: np.random.Generator) -> None:
    """Of a point of the mesh the estimator knows where it is in its own frame."""
    T = transform(Rotation.random(random_state=3).as_matrix(), rng.normal(size=3))
    frames = EstimatorFrames(lambda _: SIDECAR, lambda _: "v1")
    pose = frames.pose_of_mesh("part", estimate(T))
    in_mesh = rng.normal(size=3)
    turn = Rotation.from_quat([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    in_estimator = turn.inv().apply(in_mesh - [0.01, -0.02, 0.03])
    expected = T[:3, :3] @ in_estimator + T[:3, 3]
    moved = pose.T_world_object
    np.testing.assert_allclose(moved[:3, :3] @ in_mesh + moved[:3, 3], expected, atol=1e-6)
    assert (pose.frame_id, pose.stamp_ns, pose.notes) == ("camera", 5, ("a note",))


def test_the_covariance_is_that_of_the_moved_origin(rng: np.random.Generator) -> None:
    """Against samples of the estimator's pose."""
    print("fixture rng")
    A = rng.normal(size=(6, 6)) * np.repeat([1e-3, 1e-2], 3)[:, None]
    T = transform(Rotation.random(random_state=4).as_matrix(), rng.normal(size=3))
    frames = EstimatorFrames(lambda _: SIDECAR, lambda _: "v1")
    pose = frames.pose_of_mesh("part", estimate(T, A @ A.T))
    errors = rng.multivariate_normal(np.zeros(6), A @ A.T, size=20000)
    offset = pose.T_world_object[:3, 3] - T[:3, 3]
    shifts = errors[:, :3] + Rotation.from_rotvec(errors[:, 3:]).apply(offset) - offset
    sampled = np.cov(np.hstack([shifts, errors[:, 3:]]).T)
    scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
    assert np.abs((pose.covariance - sampled) / scale).max() < 0.05


def test_a_part_without_one_keeps_its_estimate() -> None:
    pose = estimate(np.eye(4))
    frames = EstimatorFrames(lambda _: Sidecar(), lambda _: "v1")
    assert frames.pose_of_mesh("part", pose) is pose


def test_a_file_is_read_again_as_soon_as_it_has_changed(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_text("solid\n")
    frames = EstimatorFrames(
        MeshCatalogue([tmp_path]).sidecar, lambda name: fingerprint([tmp_path], name, 10_000)
    )
    pose = estimate(np.eye(4))
    assert frames.pose_of_mesh("part", pose) is pose
    (tmp_path / "part.yaml").write_text(TEXT)
    offset = frames.pose_of_mesh("part", pose)
    assert offset.T_world_object[1, 3] == pytest.approx(0.01, abs=1e-6)
    # Half of it is there while it is written: that says nothing of the frame.
    (tmp_path / "part.yaml").write_text(TEXT[:-10])
    with pytest.raises(MeshError) as caught:
        frames.pose_of_mesh("part", pose)
    assert caught.value.code == ErrorCode.MESH_SIDECAR_INVALID
    (tmp_path / "part.yaml").write_text(TEXT)
    again = frames.pose_of_mesh("part", pose)
    assert np.array_equal(again.T_world_object, offset.T_world_object)


def test_a_file_that_stays_is_read_once() -> None:
    read: list[str] = []

    def sidecar(name: str) -> Sidecar:
        read.append(name)
        return SIDECAR

    frames = EstimatorFrames(sidecar, lambda _: "v1")
    for _ in range(3):
        frames.pose_of_mesh("part", estimate(np.eye(4)))
    assert read == ["part"]


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("{}", "position"),
        ("{place: [0, 0, 0]}", "position"),
        ("{position: [0, 0]}", "three numbers"),
        ("{position: [0, 0, 30]}", "metres"),
        ("{orientation_xyzw: [0, 0, 0, 2]}", "length 1"),
        ("{orientation_xyzw: [0, 0, 1]}", "four numbers"),
        ("5", "position"),
    ],
)
def test_what_is_no_frame_is_refused(value: str, words: str) -> None:
    with pytest.raises(MeshError, match=words) as caught:
        parse_sidecar(f"estimator_frame: {value}".encode(), "part.yaml")
    assert caught.value.code is ErrorCode.MESH_SIDECAR_INVALID


def test_of_equal_poses_one_is_taken_and_the_covariance_moves_with_it(
    rng: np.random.Generator,
) -> None:
    text = "symmetries: [{axis: [0, 0, 1], order: 4, point: [0.01, 0, 0]}]"
    frames = EstimatorFrames(lambda _: parse_sidecar(text.encode(), "part.yaml"), lambda _: "v1")
    T = transform(Rotation.random(random_state=5).as_matrix(), rng.normal(size=3))
    about = transform(np.eye(3), [0.01, 0.0, 0.0])
    found = []
    for quarter in range(4):
        R = Rotation.from_euler("z", 90 * quarter, degrees=True).as_matrix()
        turned = T @ about @ transform(R, np.zeros(3)) @ np.linalg.inv(about)
        pose = frames.pose_of_mesh("part", estimate(turned, 1e-4 * np.eye(6)))
        found.append(pose.T_world_object)
        # A sure turn about another point is an unsure shift there.
        offset = pose.T_world_object[:3, 3] - turned[:3, 3]
        shift = 1e-4 * (np.eye(3) + offset @ offset * np.eye(3) - np.outer(offset, offset))
        np.testing.assert_allclose(pose.covariance[:3, :3], shift, atol=1e-12)
    np.testing.assert_allclose(found, np.broadcast_to(found[0], (4, 4, 4)), atol=1e-12)
