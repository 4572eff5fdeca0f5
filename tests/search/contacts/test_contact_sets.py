"""Contact sets hold: forces within the friction cones that balance, by a linear programme."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.optimize import linprog

from gpis_grasp_planner.search.contacts.contact_sets import ContactSampler

FRICTION = 0.5
EDGES = 64


@pytest.fixture(scope="module")
def parts(oracle):
    return {
        "ball": oracle.make_part("ball", trimesh.creation.icosphere(3, 0.03)),
        "box": oracle.make_part("box", trimesh.creation.box(extents=(0.06, 0.04, 0.08))),
        "rod": oracle.make_part("rod", trimesh.creation.cylinder(0.005, 0.12, sections=48)),
    }


def balanced(points, normals_outward, friction):
    """Whether contacts (k, 3) can press on a part so that all forces and torques cancel."""
    wrenches = []
    for p, n in zip(points, normals_outward, strict=True):
        u = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
        u /= np.linalg.norm(u)
        v = np.cross(n, u)
        for a in 2.0 * np.pi * np.arange(EDGES) / EDGES:
            force = -n + friction * (np.cos(a) * u + np.sin(a) * v)
            wrenches.append([*force, *(np.cross(p - points[0], force) / 0.05)])
    A = np.vstack([np.array(wrenches).T, np.ones(len(wrenches))])
    solution = linprog(np.zeros(A.shape[1]), A_eq=A, b_eq=[*np.zeros(6), 1.0])
    return solution.status == 0


@pytest.mark.parametrize("name", ["ball", "box", "rod"])
@pytest.mark.parametrize("kind", ["pairs", "triples"])
def test_the_contacts_of_a_set_balance(name, kind, parts, planner, rng):
    part = parts[name]
    atlas = planner.prepare(part).atlas
    sampler = ContactSampler(atlas, part.center_of_mass, part.max_radius, FRICTION, rng)
    sets = getattr(sampler, kind)(0.2)
    if (name, kind) == ("rod", "triples"):
        assert len(sets) < 4000  # three points about a thin rod seldom meet in one
    else:
        assert len(sets) > 50
    assert len(sets) == 0 or sets.weight.sum() == pytest.approx(1.0)
    for row in sets.draw(min(len(sets), 40), rng) if len(sets) else []:
        # The inscribed pyramid is a little smaller than the cone.
        assert balanced(sets.points[row], sets.normals_outward[row], 1.01 * FRICTION)


def test_points_are_on_the_surface_and_no_wider_than_asked(parts, planner, rng):
    part = parts["ball"]
    sampler = ContactSampler(planner.prepare(part).atlas, np.zeros(3), 0.03, FRICTION, rng)
    for sets in (sampler.pairs(0.2), sampler.triples(0.2)):
        assert np.abs(np.linalg.norm(sets.points, axis=2) - 0.03).max() < 5e-4
        radial = sets.points / np.linalg.norm(sets.points, axis=2, keepdims=True)
        assert np.einsum("nki,nki->nk", radial, sets.normals_outward).min() > 0.95
    pairs = sampler.pairs(0.055)
    assert np.linalg.norm(pairs.points[:, 0] - pairs.points[:, 1], axis=1).max() < 0.055


def test_contacts_of_a_long_part_are_near_its_centre_of_mass(parts, planner, rng):
    part = parts["rod"]
    center = np.array([0.0, 0.0, 0.03])
    atlas = planner.prepare(part).atlas
    sets = ContactSampler(atlas, center, part.max_radius, FRICTION, rng).pairs(0.2)
    drawn = sets.points[sets.draw(500, rng)].mean(axis=1)[:, 2]
    assert np.abs(drawn - 0.03).mean() < 0.5 * np.abs(atlas.points[:, 2] - 0.03).mean()


def test_edges_are_avoided(parts, planner, rng):
    part = parts["box"]
    half = np.array([0.03, 0.02, 0.04])
    sets = ContactSampler(
        planner.prepare(part).atlas, np.zeros(3), part.max_radius, FRICTION, rng
    ).pairs(0.2)
    points = sets.points[sets.draw(400, rng)].reshape(-1, 3)
    to_edge = np.sort(half - np.abs(points), axis=1)[:, 1]
    assert (to_edge < 0.001).mean() < 0.05


def test_without_friction_cones_that_meet_there_is_no_set(parts, planner, rng):
    part = parts["box"]
    sampler = ContactSampler(planner.prepare(part).atlas, np.zeros(3), 0.05, FRICTION, rng)
    assert len(sampler.pairs(0.01)) == 0  # no two faces are as near
    assert len(sampler.pairs(0.2).none()) == 0
