"""Images of grasps under a part's symmetries."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose

from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.quality.wrench_space import grasp_quality
from gpis_grasp_planner.search.refinement import grasp_images
from gpis_grasp_planner.search.refinement.grasp_images import GraspImages


@pytest.fixture(scope="module")
def bar(oracle):
    """A bar of 50 x 35 x 120 mm: three planes, three half-turns, the inversion."""
    solid = trimesh.creation.box((0.05, 0.035, 0.12)).subdivide().subdivide()
    return oracle.make_part("bar", solid)


@pytest.fixture
def grasped(bar, make_context, oracle):
    """A context whose archive holds one real, one-sided grasp of the bar."""
    context = make_context(bar, seed=5)
    rng = np.random.default_rng(1)
    palm = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    for _ in range(400):
        T = np.eye(4)
        T[:3, :3] = oracle.rotation_about(rng.standard_normal(3), 0.3) @ palm
        T[:3, 3] = rng.uniform(-0.01, 0.01, 3)
        T[2, 3] += 0.06 + context.T_palm_face[2, 3] + rng.uniform(0.0, 0.04)
        attempts = context.evaluator.attempt(T[None], rng.uniform(0.3, 1.5, (1, 1)))
        if attempts.status[0] == AttemptStatus.GRASPED and attempts.epsilon[0] > 0.05:
            context.archive.add(attempts)
            return context
    raise AssertionError("no grasp of the bar")


def quality(contacts, part):
    return grasp_quality(contacts, part.center_of_mass, part.max_radius, 8)


class Recording:
    """An evaluator that keeps what it was asked and what it answered."""

    def __init__(self, evaluator):
        self._evaluator = evaluator
        self.results = []

    def __getattr__(self, name):
        return getattr(self._evaluator, name)

    def attempt(self, T_object_palm, spread):
        self.results.append(self._evaluator.attempt(T_object_palm, spread))
        return self.results[-1]


def test_the_images_of_a_grasp_are_grasps_as_good(grasped):
    grasp = grasped.archive.best(1)[0]
    recording = Recording(grasped.evaluator)
    object.__setattr__(grasped, "evaluator", recording)
    assert GraspImages(grasped).step()
    [images] = recording.results
    assert len(images) == 7
    assert np.all(images.status == AttemptStatus.GRASPED)
    # The part is its own image; its distance field is so to a fraction of a grid cell.
    part = grasped.part
    original = quality(grasp.attempts.contacts(grasp.index), part)
    for k in range(7):
        image = quality(images.contacts(k), part)
        assert image.epsilon == pytest.approx(original.epsilon, rel=0.1)
        assert image.volume == pytest.approx(original.volume, rel=0.2)
    assert np.all(np.linalg.det(images.T_object_palm[:, :3, :3]) == pytest.approx(1.0))
    # Contacts, too: each image touches where the image of the grasp does.
    contacts = grasp.attempts.contacts(grasp.index).positions
    corners = {tuple(np.sign(np.round(p, 9))) for p in images.T_object_palm[:, :3, 3]}
    assert len(corners) == 7
    for k in range(7):
        reach = np.sort(np.abs(images.contacts(k).positions).max(axis=0))
        assert_allclose(reach, np.sort(np.abs(contacts).max(axis=0)), atol=2e-3)


def test_every_grasp_is_imaged_once_and_images_are_not(grasped, oracle):
    recording = Recording(grasped.evaluator)
    object.__setattr__(grasped, "evaluator", recording)
    images = GraspImages(grasped)
    first = grasped.archive.best(1)[0]
    assert images.step()
    assert not images.step()
    # A better one beside the first has images of its own.
    better = first.T_object_palm.copy()
    better[0, 3] += 1e-4
    grasped.archive.add(oracle.make_attempts(better[None], [0.9]))
    assert images.step()
    assert not images.step()
    assert [len(result) for result in recording.results] == [7, 7]


def test_an_empty_archive_has_no_images(bar, make_context, recording_evaluator):
    context = make_context(bar, evaluator=recording_evaluator())
    assert not GraspImages(context).step()
    assert context.evaluator.n_attempts == 0


def test_a_part_without_symmetries_costs_nothing(grasped, monkeypatch):
    monkeypatch.setattr(grasp_images, "near_symmetries", lambda *_: ())
    before = grasped.evaluator.n_attempts
    assert not GraspImages(grasped).step()
    assert grasped.evaluator.n_attempts == before


def test_a_hand_without_a_plane_is_turned_only(grasped, monkeypatch):
    monkeypatch.setattr(grasp_images, "hand_mirror", lambda hand: None)
    recording = Recording(grasped.evaluator)
    object.__setattr__(grasped, "evaluator", recording)
    grasp = grasped.archive.best(1)[0]
    GraspImages(grasped).step()
    [images] = recording.results
    assert len(images) == 3
    for T in images.T_object_palm:
        turn = T @ np.linalg.inv(grasp.T_object_palm)
        assert np.trace(turn[:3, :3]) == pytest.approx(-1.0, abs=1e-9)


def test_no_tolerance_no_images(bar, make_context):
    settings = PlannerSettings.from_mapping({"refinement": {"image_tolerance": 0.0}})
    images = GraspImages(make_context(bar, settings=settings))
    assert not images.step()
