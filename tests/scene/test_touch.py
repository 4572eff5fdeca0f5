"""Contacts: on the mesh, within the threshold of their link, normals right; none is missed."""

import numpy as np
import pytest

from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.scene.grasp_kernel import MAX_CONTACTS
from gpis_grasp_planner.scene.touch import MAX_PER_LINK

TOLERANCE = 2e-6


def lies_on_some(triangles, point):
    """Whether a point is a convex combination of some triangle's corners, to 1e-9 m."""
    a, b, c = (triangles[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1)
    normal /= area[:, None]
    shares = [
        np.einsum("ij,ij->i", np.cross(v - u, point - u), normal) / area
        for u, v in ((a, b), (b, c), (c, a))
    ]
    off_plane = np.abs(np.einsum("ij,ij->i", point - a, normal))
    return bool(((np.min(shares, axis=0) > -1e-6) & (off_plane < 1e-9)).any())


def height_over(piece, points):
    n = piece.face_normals_outward
    return (points @ n.T - np.einsum("ij,ij->i", n, piece.triangles[:, 0])).max(axis=1)


def grasped(s, n, rng):
    T, spread = s.cleared(n, rng)
    a = s.evaluator.attempt(T, spread)
    return a, np.flatnonzero(a.status == AttemptStatus.GRASPED)


@pytest.mark.parametrize("name", ["mug", "phone", "ball", "box", "flange"])
def test_contacts_are_where_links_touch_the_mesh(scene, name, rng):
    s = scene(name)
    threshold = s.settings.contact_threshold_m
    a, rows = grasped(s, 40, rng)
    assert len(rows) > 5
    for row in rows:
        c = a.contacts(row)
        assert 2 <= len(c) <= MAX_CONTACTS
        assert np.bincount(c.links).max() <= MAX_PER_LINK
        np.testing.assert_allclose(np.linalg.norm(c.normals_inward, axis=1), 1.0, atol=1e-9)
        T_links = a.T_object_palm[row] @ link_transforms(s.hand, a.joints[row][None])[0]
        for p, n, link in zip(c.positions, c.normals_inward, c.links, strict=True):
            assert lies_on_some(s.part.mesh.triangles, p)
            T = T_links[link]
            in_link = (p - T[:3, 3]) @ T[:3, :3]
            height = min(height_over(m, in_link[None])[0] for m in s.hand.link_collision[link])
            assert -TOLERANCE < height < threshold + TOLERANCE
            # back along the normal there is the link, and forward it is left
            back = in_link - threshold * (n @ T[:3, :3])
            assert (
                min(height_over(m, back[None])[0] for m in s.hand.link_collision[link]) < TOLERANCE
            )


@pytest.mark.parametrize("name", ["box", "ball"])
def test_normals_point_into_a_convex_object(scene, name, rng):
    s = scene(name)
    a, rows = grasped(s, 60, rng)
    for row in rows:
        c = a.contacts(row)
        assert (np.einsum("ij,ij->i", c.normals_inward, c.positions) < 0.0).all()
        if name == "box":
            on_face = np.isclose(np.abs(c.positions), [0.025, 0.03, 0.04], atol=1e-6)
            inside_face = on_face.sum(axis=1) == 1
            expected = -np.sign(c.positions[inside_face]) * on_face[inside_face]
            np.testing.assert_allclose(c.normals_inward[inside_face], expected, atol=1e-3)


@pytest.mark.parametrize("name", ["mug", "box", "stepped_shaft"])
def test_every_touching_link_has_a_contact_and_no_other_one(scene, name, rng):
    s = scene(name)
    threshold = s.settings.contact_threshold_m
    a, rows = grasped(s, 40, rng)
    missed = touching = 0
    for row in rows:
        c = a.contacts(row)
        gaps = s.gaps(a.T_object_palm[row], a.joints[row])
        assert (gaps[c.links] < threshold + TOLERANCE).all()
        if len(c) == MAX_CONTACTS:
            continue
        near = np.flatnonzero(gaps < threshold - TOLERANCE)
        touching += len(near)
        missed += len(set(near) - set(c.links))
    print(f"{missed} of {touching} touching links have no contact")
    assert touching > 30
    assert missed <= 0.01 * touching


def test_friction_is_that_of_the_pair(scene, rng):
    s = scene("mug")
    a, rows = grasped(s, 40, rng)
    palm = np.array([group == "palm" for group in s.hand.link_friction_group])
    for row in rows:
        c = a.contacts(row)
        expected = np.where(palm[c.links], s.evaluator.friction.palm, s.evaluator.friction.finger)
        np.testing.assert_array_equal(c.friction, expected)


def test_pad_flat_on_a_face_gives_a_patch_not_a_point(scene, rng):
    """Two contacts of a link at least are as far apart as a pad is wide, in some grasps."""
    s = scene("box")
    a, rows = grasped(s, 60, rng)
    widest = 0.0
    for row in rows:
        c = a.contacts(row)
        for link in set(c.links):
            p = c.positions[c.links == link]
            widest = max(widest, np.linalg.norm(p[:, None] - p[None], axis=2).max())
    assert widest > 0.015
