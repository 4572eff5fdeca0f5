"""Places and covariances in their JSON form."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.surroundings.covariance import check_covariance, covariance_in_object
from gpis_grasp_planner.surroundings.place import STAND_IN, Place, read_covariance

FULL = {
    "object": {"position": [0.5, 0.1, 0.8], "quat_xyzw": [0.0, 0.6, 0.0, 0.8]},
    "support": {"name": "bench", "point": [0.0, 0.0, 0.75], "normal": [0.0, 0.0, 2.0]},
    "obstacles": [
        {"name": "wall", "position": [0.6, 0, 0.9], "size": [0.02, 1.0, 0.3]},
        {"name": "bin", "quat_xyzw": [0, 0, 1, 0], "mesh": "crate"},
    ],
    "covariance": [1e-6, 2e-6, 3e-6, 1e-4, 2e-4, 3e-4],
}


def test_the_json_form_says_everything(rng):
    asked = []

    def load(source: str) -> TriangleMesh:
        asked.append(source)
        return STAND_IN

    place = Place.from_mapping(FULL, load)
    assert asked == ["crate"]
    assert np.array_equal(place.covariance, np.diag(FULL["covariance"]))
    R = Rotation.from_quat(FULL["object"]["quat_xyzw"]).as_matrix()
    assert place.T_world_object[:3, :3] == pytest.approx(R)
    around = place.around()
    assert around.support.normal == pytest.approx(R.T @ [0, 0, 1])
    p_object = R.T @ (np.array([0.6, 0, 0.9]) - FULL["object"]["position"])
    assert around.obstacles[0].pose[:3, 3] == pytest.approx(p_object)
    text = json.dumps(place.as_mapping(), allow_nan=False)
    again = Place.from_mapping(json.loads(text), load)
    assert again.as_mapping()["support"] == place.as_mapping()["support"]
    np.testing.assert_allclose(again.T_world_object, place.T_world_object, atol=1e-15)
    for one, other in zip(again.surroundings.obstacles, place.surroundings.obstacles, strict=True):
        np.testing.assert_allclose(one.pose, other.pose, atol=1e-15)
        assert (one.name, type(one)) == (other.name, type(other))
    assert np.array_equal(again.covariance, place.covariance)


def test_a_place_is_true_where_anything_depends_on_it():
    assert not Place.from_mapping({})
    assert not Place.from_mapping({"object": {"position": [1, 2, 3]}})
    assert Place.from_mapping({"support": {}})
    assert Place.from_mapping({"covariance": [0.0] * 6})


@pytest.mark.parametrize(
    ("data", "code", "word"),
    [
        ({"table": {}}, "INVALID_SCENE", "'table'"),
        ([], "INVALID_SCENE", "list"),
        ({"object": [0, 0, 0]}, "INVALID_SCENE", "object's pose"),
        ({"object": {"xyz": [0, 0, 0]}}, "INVALID_SCENE", "'xyz'"),
        ({"object": {"quat_xyzw": [0, 0, 0, 2]}}, "INVALID_SCENE", "norm 2"),
        ({"object": {"position": ["a", 0, 0]}}, "INVALID_SCENE", "3 finite numbers"),
        ({"covariance": [1.0] * 7}, "INVALID_COVARIANCE", "7 numbers"),
        ({"covariance": "much"}, "INVALID_COVARIANCE", "0 numbers"),
        ({"covariance": [-1.0] * 6}, "INVALID_COVARIANCE", "-1"),
        ({"obstacles": [{"mesh": "a"}]}, "INVALID_SCENE", "not taken here"),
    ],
)
def test_what_is_malformed_is_refused(data, code, word):
    with pytest.raises(GraspPlannerError, match=word) as caught:
        Place.from_mapping(data)
    assert caught.value.code == ErrorCode[code]


def test_36_numbers_go_row_by_row(rng):
    A = rng.normal(size=(6, 6))
    C = A @ A.T
    assert np.array_equal(read_covariance(C.ravel().tolist()), check_covariance(C))


def test_the_objects_axes(rng):
    """Drawn about the world's axes and looked at from the object's: the same covariance."""
    A = rng.normal(size=(6, 6))
    R = Rotation.random(random_state=rng.integers(1 << 30)).as_matrix()
    x = rng.standard_normal((200_000, 6)) @ A.T
    seen = np.concatenate([x[:, :3] @ R, x[:, 3:] @ R], axis=1)
    C = covariance_in_object(A @ A.T, R)
    np.testing.assert_allclose(np.cov(seen.T), C, atol=0.03 * np.abs(C).max())


def test_a_bare_pose_is_false_and_written_all_the_same():
    T = np.eye(4)
    T[:3, 3] = [0.1, 0.0, 0.2]
    assert not Place(T)
    written = Place(T).as_mapping_if_stated()
    assert np.array_equal(Place.from_mapping(written).T_world_object, T)
    assert Place().as_mapping_if_stated() is None
