"""What the page shows is what the document says, and the way to a grasp passes through nothing."""

import numpy as np
import pytest

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.hand.description import available_hands, load_hand
from gpis_grasp_planner.hand.drive import reachable
from gpis_grasp_planner.hand.surface_points import SurfacePoints
from gpis_grasp_planner.plan.document import read_document
from gpis_grasp_planner.quality.wrench_space import contact_wrenches
from gpis_grasp_planner.scene.arrays import kept_surface_points
from gpis_grasp_planner.view.grasp_scene import (
    GraspScene,
    friction_cones,
    sorted_indices,
)


@pytest.fixture(scope="module")
def scene(mug_document):
    result = read_document(mug_document).result
    part = MeshCatalogue([default_catalogue_directory()]).load("mug")
    return GraspScene.of_result(part, load_hand(result.hand), result)


def deepest(scene, frame, field, points: SurfacePoints) -> float:
    """Largest depth [m] of the hand's surface points in the part of a frame."""
    T_part_object = np.linalg.inv(frame.T_object_part)
    values = [
        field.value(apply(T_part_object @ T, points.points[a:b])).min()
        for T, a, b in zip(
            scene.link_poses(frame), points.offsets[:-1], points.offsets[1:], strict=True
        )
        if b > a
    ]
    return -min(values)


def test_no_moment_of_the_motion_passes_through_the_part(scene):
    field = DistanceField.of(scene.part.mesh)
    points = kept_surface_points(scene.hand)
    assert len(scene.grasps) >= 2
    for grasp in scene.grasps[:4]:
        for frame in scene.motion(grasp):
            assert deepest(scene, frame, field, points) < 2.5e-3, frame.phase


def test_the_motion_begins_open_closes_by_the_drive_and_lifts_away_from_the_table(scene):
    for grasp in scene.grasps:
        frames = scene.motion(grasp)
        phases = [frame.phase for frame in frames]
        assert phases == sorted(phases, key=("approach", "closing", "lift").index)
        assert set(phases) == {"approach", "closing", "lift"}
        first, last = frames[0], frames[-1]
        back = first.T_object_palm[:3, 3] - grasp.T_object_palm[:3, 3]
        np.testing.assert_allclose(
            back, -grasp.approach_distance * grasp.approach_direction, atol=1e-12
        )
        np.testing.assert_array_equal(first.joints, grasp.pregrasp_joints)
        closing = np.array([f.joints for f in frames if f.phase == "closing"])
        np.testing.assert_array_equal(closing[-1], grasp.joints)
        assert reachable(scene.hand, closing).all()
        fingers = scene.hand.of_fingers(closing).reshape(len(closing), -1)
        assert (np.diff(fingers, axis=0) > -1e-9).all()  # nothing opens while it closes
        carried = last.T_object_part
        assert carried[:3, 3] @ [0.0, 0.0, 1.0] == pytest.approx(0.1)
        # the part goes with the palm
        np.testing.assert_allclose(
            np.linalg.inv(last.T_object_palm) @ carried,
            np.linalg.inv(grasp.T_object_palm),
            atol=1e-12,
        )


def test_the_weakest_wrench_is_where_the_hull_reaches_epsilon_and_no_further(scene):
    for grasp in scene.grasps:
        found = scene.weakest(grasp)
        wrench = np.append(found.force, found.torque)
        assert np.linalg.norm(wrench) == pytest.approx(1.0)
        edges = contact_wrenches(
            grasp.contacts, scene.part.center_of_mass, scene.part.max_radius, scene.cone_edges
        )
        assert (edges @ wrench).max() == pytest.approx(grasp.epsilon, abs=1e-8)


def test_cones_stand_on_the_contacts_and_are_as_wide_as_the_friction(scene):
    grasp = scene.grasps[0]
    cones = friction_cones(grasp)
    assert len(cones) == len(grasp.contacts) > 0
    contacts = grasp.contacts
    for mesh, p, n, mu in zip(
        cones, contacts.positions, contacts.normals_inward, contacts.friction, strict=True
    ):
        along = (mesh.vertices - p) @ n
        across = np.linalg.norm(mesh.vertices - p - along[:, None] * n, axis=1)
        np.testing.assert_allclose(across, mu * along, atol=1e-9)
        assert along.min() == pytest.approx(0.0, abs=1e-9)


def test_the_support_is_under_the_part_at_the_height_of_its_lowest_point(scene):
    [(name, slab)] = scene.surroundings().items()
    assert name == "support"
    assert slab.vertices[:, 2].max() == pytest.approx(scene.part.mesh.vertices[:, 2].min())
    assert (slab.bounds[0, :2] < scene.part.mesh.bounds[0, :2]).all()
    assert (slab.bounds[1, :2] > scene.part.mesh.bounds[1, :2]).all()


@pytest.mark.parametrize("order", ["epsilon", "volume"])
def test_the_list_can_be_sorted(scene, order):
    figures = [getattr(scene.grasps[i], order) for i in sorted_indices(scene.grasps, order)]
    assert figures == sorted(figures, reverse=True)
    assert sorted_indices(scene.grasps, "answer") == list(range(len(scene.grasps)))


@pytest.mark.parametrize("name", available_hands())
def test_every_hand_has_a_shape_for_each_link_that_has_one_to_touch_with(scene, name):
    hand = load_hand(name)
    shapes = GraspScene(scene.part, hand, scene.place).link_shapes
    assert [bool(s) for s in shapes] == [bool(s) for s in hand.link_collision]
