"""The guided potential by hand, and again from geometry alone."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial import ConvexHull

from gpis_grasp_benchmark.rivals.hand_states import HandStates
from gpis_grasp_planner.scene.guided_potential import contact_scale, potential_energy

HALF_BOX = np.array([0.03, 0.02, 0.04])
AXES = np.concatenate([np.eye(3), -np.eye(3)])


def energy_of(distance_mm, cosine, outward):
    n = len(distance_mm)
    arrays = (np.asarray(a, dtype=float) for a in (distance_mm, cosine, outward))
    return potential_energy(*arrays, np.empty((8 * n, 3)))


def ring(normal):
    """The forces of a pyramid of friction 0.2, first tangent e_y x n."""
    x = np.cross([0.0, 1.0, 0.0], normal)
    x = x / np.linalg.norm(x) if np.linalg.norm(x) > 1e-9 else np.array([1.0, 0.0, 0.0])
    y = np.cross(normal, x)
    angle = 2.0 * np.pi * np.arange(8)[:, None] / 8
    return normal + 0.2 * (np.cos(angle) * x + np.sin(angle) * y)


def recomputed(distance_mm, cosine, outward):
    """The energy, written again with Qhull."""
    near = (cosine >= 0.7) & (distance_mm <= 50.0)
    scale = np.where(near, np.cos(np.pi * distance_mm / 50.0) + 1.0, 0.0)
    if np.sum(scale > 0.25) >= 3:
        active = scale > 0.0
        pairs = zip(scale[active], outward[active], strict=True)
        P = np.concatenate([s * ring(n) for s, n in pairs])
        nearest = -ConvexHull(P, qhull_options="QJ").equations[:, -1].max()
        if nearest > 0.0:
            return -nearest
    return float(np.mean(distance_mm + 50.0 * (1.0 - cosine)))


@pytest.mark.parametrize(
    ("distance_mm", "cosine", "scale"),
    [
        (0.0, 1.0, 2.0),
        (25.0, 1.0, 1.0),
        (50.0, 1.0, 0.0),
        (50.001, 1.0, 0.0),
        (200.0, 1.0, 0.0),
        (0.0, 0.7, 2.0),
        (0.0, 0.699, 0.0),
        (0.0, -1.0, 0.0),
        (50.0 / 3.0, 0.9, 1.5),
    ],
)
def test_scales(distance_mm, cosine, scale):
    assert contact_scale(distance_mm, cosine) == pytest.approx(scale, abs=1e-12)


@pytest.mark.parametrize(
    ("distance_mm", "cosine", "outward", "energy"),
    [
        # far away: mean(d + 50 (1 - cos))
        ([100.0, 300.0], [1.0, 0.0], AXES[:2], 225.0),
        ([60.0] * 6, [1.0] * 6, AXES, 60.0),
        # near, but the normals disagree
        ([10.0] * 6, [0.5] * 6, AXES, 35.0),
        # two near ones are too few, and so are three that are nearly out of reach
        ([0.0, 0.0, 90.0], [1.0, 1.0, 1.0], AXES[[0, 3, 1]], 30.0),
        ([48.0] * 6, [1.0] * 6, AXES, 48.0),
        # three near ones, all from one side: the hull leaves the origin out
        ([0.0, 0.0, 0.0], [1.0, 1.0, 0.9], [[1, 0, 0], [0, 1, 0], [0, 0, 1]], 5.0 / 3.0),
    ],
)
def test_energies_without_a_closed_hull(distance_mm, cosine, outward, energy):
    assert energy_of(distance_mm, cosine, outward) == pytest.approx(energy, abs=1e-12)


def test_six_contacts_along_the_axes():
    # Forces 2 (e_i + 0.2 ring), each ring an octagon with a corner along both other axes. Of the
    # hull's facets those near (1, 1, 1) are nearest: the corners at 45 degrees between the axes,
    # 2 (1, 0.2 c, 0.2 c) with c = cos 45 and their permutations, span one of them.
    expected = 2.0 * (1.0 + 0.4 * np.cos(np.pi / 4)) / np.sqrt(3.0)
    assert energy_of([0.0] * 6, [1.0] * 6, AXES) == pytest.approx(-expected, abs=1e-9)
    assert energy_of([25.0] * 6, [1.0] * 6, AXES) == pytest.approx(-expected / 2.0, abs=1e-9)


def test_agrees_with_the_formula_written_again(rng):
    closed = 0
    for _ in range(400):
        n = int(rng.integers(6, 20))
        outward = rng.normal(size=(n, 3))
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        distance = rng.uniform(0.0, 60.0, n)
        cosine = rng.uniform(0.4, 1.0, n)
        expected = recomputed(distance, cosine, outward)
        assert energy_of(distance, cosine, outward) == pytest.approx(expected, abs=1e-7)
        closed += expected < 0.0
    assert closed > 50


def test_energies_of_hands_round_a_box(box, make_context, random_states, link_frames, rng):
    """From states alone: frames by the chain, nearest points of a box by clipping."""
    context = make_context(box)
    wanted = context.hand.desired_contacts
    T, joints = HandStates(context).hands(random_states(context, rng, 400))
    energy = context.evaluator.guided_potential(T, joints)
    assert context.evaluator.n_states == 400
    assert context.evaluator.n_attempts == 0
    legal = np.flatnonzero(np.isfinite(energy))
    assert 60 < len(legal) < 390
    for i in legal:
        frames = link_frames(context.hand, T[i], joints[i])[wanted.links]
        points = np.einsum("nij,nj->ni", frames[:, :3, :3], wanted.points) + frames[:, :3, 3]
        outward = np.einsum("nij,nj->ni", frames[:, :3, :3], wanted.normals)
        away = np.clip(points, -HALF_BOX, HALF_BOX) - points
        distance = np.linalg.norm(away, axis=1)
        cosine = np.sum(outward * away, axis=1) / distance
        assert energy[i] == pytest.approx(recomputed(1e3 * distance, cosine, outward), abs=1e-6)
    assert energy[legal].min() < 0.0


def test_colliding_hands_have_no_energy(box, make_context, random_states, rng, oracle):
    """Legal hands overlap nothing, refused ones overlap the box or themselves (checked by LP)."""
    context = make_context(box)
    T, joints = HandStates(context).hands(random_states(context, rng, 16))
    energy = context.evaluator.guided_potential(T, joints)
    corners = box.mesh.vertices
    fingers = [(f.inner_link, f.distal_link) for f in context.hand.fingers]
    for i in range(len(T)):
        links = oracle.posed_links(context.hand, T[i], joints[i])
        hits_box = any(oracle.convex_overlap(p, corners) for pieces in links for p in pieces)
        pairs = [(a, b) for k, own in enumerate(fingers) for a in own
                 for other in fingers[:k] for b in other]  # fmt: skip
        pairs += [(f.distal_link, 0) for f in context.hand.fingers]
        hits_itself = any(
            oracle.convex_overlap(p, q) for a, b in pairs for p in links[a] for q in links[b]
        )
        if np.isfinite(energy[i]):
            assert not hits_box
            assert not hits_itself
        elif not hits_box and not hits_itself:
            # what remains: a finger in another one's knuckle
            knuckles = [(f.distal_link, g.knuckle_link) for f in context.hand.fingers
                        for g in context.hand.fingers if f is not g]  # fmt: skip
            assert any(
                oracle.convex_overlap(p, q) for a, b in knuckles for p in links[a] for q in links[b]
            )


def test_batches_and_single_states_agree(box, make_context, random_states, rng):
    context = make_context(box)
    T, joints = HandStates(context).hands(random_states(context, rng, 40))
    one_by_one = [
        context.evaluator.guided_potential(T[i : i + 1], joints[i : i + 1])[0] for i in range(40)
    ]
    assert_allclose(context.evaluator.guided_potential(T, joints), one_by_one, rtol=0.0, atol=0.0)
