"""Epsilon and volume: answers known by hand, the original simulator's figures, and invariances."""

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
import scipy.spatial
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.quality.contacts import Contacts
from gpis_grasp_planner.quality.figures import Quality
from gpis_grasp_planner.quality.wrench_space import (
    cone_edges_of,
    contact_wrenches,
    grasp_quality,
    hull_quality,
    tangents,
    weakest_direction,
)

ORIGIN = np.zeros(3)
REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "reference_grasps.json").read_text())


def quality(contacts, torque_scale=1.0, edges=8):
    return grasp_quality(contacts, ORIGIN, torque_scale, edges)


def replaced(contacts, positions=None, normals=None, order=None):
    p = contacts.positions if positions is None else positions
    n = contacts.normals_inward if normals is None else normals
    rows = np.arange(len(contacts)) if order is None else order
    return Contacts(p[rows], n[rows], contacts.friction[rows], contacts.links[rows])


def reference_wrenches(grasp):
    rows = np.array(grasp["contacts"])
    contacts = Contacts(rows[:, :3], rows[:, 3:6], rows[:, 6], np.zeros(len(rows), dtype=np.intp))
    return contact_wrenches(contacts, np.array(grasp["center_of_mass_mm"]), grasp["max_radius_mm"])


def test_figures_of_the_original_simulator():
    """Equal to the printed digits, but where the simulator's hull merged facets.

    Merging loses volume. Where epsilon differs, ours is proved: it is the support in the
    direction of a facet, which no distance of the origin from the hull's border exceeds.
    """
    epsilon_differs, volume_differs = [], []
    for grasp in REFERENCE["grasps"]:
        name = (grasp["object"], len(grasp["contacts"]))
        W = reference_wrenches(grasp)
        found = hull_quality(W)
        if abs(found.epsilon - grasp["epsilon"]) > 5e-6:
            epsilon_differs.append(name)
        if abs(found.volume - grasp["volume"]) > 1e-5:
            volume_differs.append(name)
        normal = max(ConvexHull(W).equations, key=lambda e: e[-1])[:-1]
        assert (W @ normal).max() == pytest.approx(found.epsilon, abs=1e-9)
        assert found.epsilon <= grasp["epsilon"] + 5e-6
        assert -1e-9 < found.volume - grasp["volume"] < 0.01 * grasp["volume"]
    assert epsilon_differs == [("mug", 8)]
    assert volume_differs == [("mug", 13), ("bishop", 16)]


def test_simplex_of_wrenches_has_its_known_epsilon_and_volume():
    # A regular simplex of six dimensions about the origin: inradius R/6 for circumradius R, and
    # volume sqrt(7 / 2^6) / 6! times its edge to the sixth.
    corners = np.eye(7) - 1.0 / 7.0
    basis = np.linalg.svd(corners)[2][:6]
    W = corners @ basis.T
    circumradius = np.sqrt(6.0 / 7.0)
    found = hull_quality(W)
    assert found.epsilon == pytest.approx(circumradius / 6.0, rel=1e-9)
    assert found.volume == pytest.approx(np.sqrt(7.0 / 64.0) / 720.0 * 2.0**3, rel=1e-9)


def test_six_pairs_of_unit_wrenches_are_the_cross_polytope():
    W = np.vstack([np.eye(6), -np.eye(6)])
    found = hull_quality(W)
    assert found.epsilon == pytest.approx(1.0 / np.sqrt(6.0), rel=1e-9)
    assert found.volume == pytest.approx(2.0**6 / 720.0, rel=1e-9)


def test_frictionless_cube_grasp_with_seven_contacts_and_more(grasp_of):
    # Two contacts on each face of a cube, off its middle in a swastika: force +-e_i and torque
    # +-a e_i. The hull is the sum of three squares' hull with corners (+-1, +-a) in (f_i, t_i):
    # the facet normals have one (f_i, t_i) pair of every square.
    a = 0.5
    positions, normals = [], []
    for i in range(3):
        j = (i + 1) % 3
        for side in (1.0, -1.0):
            for shift in (a, -a):
                p = np.zeros(3)
                p[i], p[j] = side, shift
                n = np.zeros(3)
                n[i] = -side
                positions.append(p)
                normals.append(n)
    W = contact_wrenches(grasp_of(positions, normals, 0.0), ORIGIN, 1.0, 8)
    assert len(np.unique(np.round(W, 12), axis=0)) == 12
    # conv of three orthogonal rectangles: 1/eps^2 = sum of the polars' largest squared norms
    expected = 1.0 / np.sqrt(3.0 * (1.0 / a) ** 2)
    assert hull_quality(W).epsilon == pytest.approx(expected, rel=1e-9)


def test_four_contacts_around_the_equator_hold_by_friction(grasp_of):
    angle = np.arange(4) * np.pi / 2
    p = np.stack([np.cos(angle), np.sin(angle), np.zeros(4)], axis=1)
    found = quality(grasp_of(p, -p, 0.5))
    assert found.force_closure
    # No wrench along the axis: the support function there is what friction gives, mu / 1.
    W = contact_wrenches(grasp_of(p, -p, 0.5), ORIGIN, 1.0)
    assert W[:, 2].max() == pytest.approx(0.5)
    assert found.epsilon <= 0.5
    assert not quality(grasp_of(p, -p, 0.0)).force_closure


@pytest.mark.parametrize("mu", [0.0, 0.3, 1.0])
def test_two_point_contacts_never_close(mu, grasp_of, rng):
    # No torque about the line through them: the wrench space is flat, whatever the friction.
    for _ in range(20):
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        assert quality(grasp_of([n, -n], [-n, n], mu)) == Quality(-1.0, 0.0)


def test_frictionless_contacts_on_a_sphere_never_close(grasp_of, rng):
    p = rng.normal(size=(12, 3))
    p /= np.linalg.norm(p, axis=1, keepdims=True)
    assert quality(grasp_of(p, -p, 0.0)) == Quality(-1.0, 0.0)


def test_three_contacts_close_exactly_if_the_normals_surround_with_friction(grasp_of):
    def equilateral(mu, tilt):
        angle = np.arange(3) * 2 * np.pi / 3
        p = np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
        n = -p + [0.0, 0.0, tilt]
        return quality(grasp_of(p, n, mu))

    assert equilateral(0.5, 0.0).force_closure
    # All normals lean up by more than the friction cone: nothing can pull down.
    assert not equilateral(0.5, 0.6).force_closure
    assert equilateral(0.5, 0.4).force_closure
    assert equilateral(0.5, 0.6).volume > 0.0


def test_no_contact_and_too_few():
    assert grasp_quality(Contacts.none(), ORIGIN, 1.0) == Quality(-1.0, 0.0)
    assert hull_quality(np.zeros((6, 6))) == Quality(-1.0, 0.0)
    assert hull_quality(np.zeros((40, 6))) == Quality(-1.0, 0.0)


def test_closure_verdict_is_that_of_a_linear_program(random_grasps):
    """The origin is inside exactly if W' x = 0 has a strictly positive solution (rank 6)."""
    closed = 0
    for contacts in random_grasps(60):
        W = contact_wrenches(contacts, ORIGIN, 1.0)
        # largest t with x >= t, sum x = 1, W'x = 0
        n = len(W)
        A = np.vstack([np.hstack([W.T, np.zeros((6, 1))]), np.r_[np.ones(n), 0.0][None]])
        bounds = [(None, None)] * (n + 1)
        G = np.hstack([-np.eye(n), np.ones((n, 1))])
        result = linprog(
            np.r_[np.zeros(n), -1.0], G, np.zeros(n), A, np.r_[np.zeros(6), 1.0], bounds
        )
        inside = result.status == 0 and -result.fun > 1e-9
        assert quality(contacts).force_closure == inside
        closed += inside
    assert 5 < closed < 60


def test_epsilon_is_the_smallest_support(random_grasps, rng):
    for contacts in random_grasps(15):
        W = contact_wrenches(contacts, ORIGIN, 1.0)
        found = hull_quality(W)
        u = rng.normal(size=(20000, 6))
        support = (W @ (u / np.linalg.norm(u, axis=1, keepdims=True)).T).max(axis=0)
        if found.force_closure:
            assert found.epsilon <= support.min() + 1e-12
        elif support.min() > 0:
            assert found.epsilon == -1.0


def test_adding_a_contact_never_lowers_epsilon_or_volume(random_grasps):
    for contacts in random_grasps(15):
        fewer = quality(replaced(contacts, order=np.arange(len(contacts) - 1)))
        more = quality(contacts)
        assert more.epsilon >= fewer.epsilon - 1e-9
        assert more.volume >= fewer.volume * (1 - 1e-6) - 1e-12


def test_more_friction_never_lowers_epsilon(random_grasps):
    for contacts in random_grasps(10):
        rough = Contacts(
            contacts.positions, contacts.normals_inward, 1.2 * contacts.friction, contacts.links
        )
        assert quality(rough).epsilon >= quality(contacts).epsilon - 1e-9


def test_volume_scales_with_the_inverse_cube_of_the_torque_scale(random_grasps):
    for contacts in random_grasps(8):
        one, two = quality(contacts, 1.0), quality(contacts, 2.0)
        assert two.volume == pytest.approx(one.volume / 8.0, rel=1e-6)
        assert one.force_closure == two.force_closure
        assert two.epsilon <= one.epsilon + 1e-12


def test_size_cancels_where_the_torque_scale_follows_it(random_grasps, rng):
    for contacts in random_grasps(8):
        shift = rng.normal(size=3)
        larger = replaced(contacts, positions=7.0 * contacts.positions + shift)
        a, b = quality(contacts), grasp_quality(larger, shift, 7.0)
        assert b.epsilon == pytest.approx(a.epsilon, abs=1e-9)
        assert b.volume == pytest.approx(a.volume, rel=1e-6)


def test_order_of_contacts_and_mirror_image_do_not_matter(random_grasps, rng):
    for contacts in random_grasps(10):
        a = quality(contacts)
        b = quality(replaced(contacts, order=rng.permutation(len(contacts))))
        flip = np.array([1.0, 1.0, -1.0])
        c = quality(replaced(contacts, contacts.positions * flip, contacts.normals_inward * flip))
        for other in (b, c):
            assert other.epsilon == pytest.approx(a.epsilon, abs=1e-9)
            assert other.volume == pytest.approx(a.volume, rel=1e-6)


def test_rotation_changes_the_figures_only_by_the_place_of_the_pyramids_edges(random_grasps, rng):
    def after_turn(contacts, edges):
        R = Rotation.random(rng=rng).as_matrix()
        turned = replaced(contacts, contacts.positions @ R.T, contacts.normals_inward @ R.T)
        return quality(contacts, edges=edges), quality(turned, edges=edges)

    changes = []
    for contacts in random_grasps(40):
        a, b = after_turn(contacts, 8)
        if a.force_closure and b.force_closure:
            changes.append(abs(a.epsilon - b.epsilon))
    print("changes of epsilon:", np.round(np.sort(changes), 4))
    assert len(changes) > 5
    assert np.median(changes) < 0.003
    # with finer pyramids, the cones themselves nearly, what is left vanishes
    few = [c for c in random_grasps(40) if len(c) <= 5 and quality(c).force_closure][:3]
    for contacts in few:
        a, b = after_turn(contacts, 24)
        assert a.epsilon == pytest.approx(b.epsilon, abs=0.002)
        assert a.volume == pytest.approx(b.volume, rel=0.03)


def test_turn_about_the_axis_that_fixes_the_tangents_changes_nothing(random_grasps):
    half_turn = np.array([1.0, -1.0, -1.0])
    for contacts in random_grasps(8):
        turned = replaced(
            contacts, contacts.positions * half_turn, contacts.normals_inward * half_turn
        )
        a, b = quality(contacts), quality(turned)
        assert b.epsilon == pytest.approx(a.epsilon, abs=1e-9)
        assert b.volume == pytest.approx(a.volume, rel=1e-6)


def test_edges_lie_on_the_cone_with_a_normal_component_of_one(random_grasps):
    for contacts in random_grasps(5):
        edges = cone_edges_of(contacts, 6)
        along = np.einsum("kei,ki->ke", edges, contacts.normals_inward)
        across = edges - along[..., None] * contacts.normals_inward[:, None]
        np.testing.assert_allclose(along, 1.0, atol=1e-12)
        np.testing.assert_allclose(
            np.linalg.norm(across, axis=2),
            np.broadcast_to(contacts.friction[:, None], along.shape),
            atol=1e-12,
        )
        np.testing.assert_allclose(across.sum(axis=1), 0.0, atol=1e-12)


def test_tangents_are_a_right_frame_also_along_x():
    normals = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, 0, -1.0], [0.6, 0.0, 0.8]])
    t_x, t_y = tangents(normals)
    np.testing.assert_allclose(np.cross(t_x, t_y), normals * 1.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(t_y, axis=1), 1.0)
    np.testing.assert_allclose(t_y[2:, 0], 0.0, atol=1e-15)


def test_torque_is_the_cross_product_about_the_center_of_mass(grasp_of):
    contacts = grasp_of([[0.3, 0.1, 0.0]], [[0.0, -1.0, 0.0]], 0.0)
    W = contact_wrenches(contacts, np.array([0.1, 0.0, 0.0]), 0.5, 3)
    np.testing.assert_allclose(W, [[0, -1, 0, 0, 0, -0.2 / 0.5]] * 3, atol=1e-15)


def test_fallbacks_after_qhull_gives_up(monkeypatch, random_grasps):
    contacts = next(c for c in random_grasps(50) if quality(c).force_closure)
    expected = quality(contacts)
    original, tried = scipy.spatial.ConvexHull, []

    def failing(points):
        tried.append(points)
        if len(tried) < 3:
            raise QhullError("made to fail")
        return original(points)

    monkeypatch.setattr(scipy.spatial, "ConvexHull", failing)
    found = quality(contacts)
    shifts = [np.abs(points - tried[0]).max() for points in tried]
    assert shifts[0] == 0.0
    assert 0.0 < shifts[1] < shifts[2] < 1e-9
    assert found.epsilon == pytest.approx(expected.epsilon, abs=1e-9)
    assert found.volume == pytest.approx(expected.volume, rel=1e-7)

    def hopeless(points):
        raise QhullError("made to fail")

    monkeypatch.setattr(scipy.spatial, "ConvexHull", hopeless)
    assert quality(contacts) == Quality(-1.0, 0.0)


def test_the_weakest_direction_of_a_box_is_across_its_thinnest_side():
    half = np.array([3.0, 2.0, 0.5, 4.0, 1.0, 5.0])
    corners = half * np.array(list(itertools.product((-1.0, 1.0), repeat=6)))
    found = weakest_direction(corners)
    assert found is not None
    np.testing.assert_allclose(np.abs(found), [0, 0, 1, 0, 0, 0], atol=1e-9)
    assert (corners @ found).max() == pytest.approx(hull_quality(corners).epsilon) == 0.5


def test_flat_wrenches_have_no_weakest_direction():
    assert weakest_direction(np.eye(6)) is None
