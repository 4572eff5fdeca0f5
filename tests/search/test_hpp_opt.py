"""Alg. 1: what is proposed, kept and told, and that the model earns its keep."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search import hpp_opt
from gpis_grasp_planner.search.hpp_opt import PalmPoseOptimiser
from gpis_grasp_planner.search.search_space import PalmSearchSpace


class FakeOptimiser:
    """Asks for a Latin hypercube and remembers what it is told."""

    def __init__(self, domain, **options):
        self.domain = domain
        self.options = options
        self.asked = []
        self.told = []

    def ask_batch(self, k):
        X = self.domain.sample(k, np.random.default_rng(len(self.asked)))
        self.asked.append(X)
        return X

    def tell(self, X, y, features=None, feasible=None):
        self.told.append((np.array(X), np.array(y), features))


@pytest.fixture
def fake_optimiser(monkeypatch):
    monkeypatch.setattr(hpp_opt, "BayesianOptimiser", FakeOptimiser)


def settings_of(**hpp):
    return PlannerSettings.from_mapping({"hpp": hpp, "adaption": {"n_seed": 5}})


def best_of(attempts, own, weight):
    """Index and value of the best of some attempts, one after the other."""
    best, value = -1, -np.inf
    for i in own:
        grasped = attempts.status[i] == AttemptStatus.GRASPED
        epsilon = attempts.epsilon[i]
        f = (epsilon if epsilon > 0.0 else 0.0) + weight * attempts.volume[i] if grasped else 0.0
        if f > value:
            best, value = i, f
    return best, value


@pytest.mark.parametrize("posture", [True, False])
def test_the_best_seed_is_told_at_the_pose_where_it_was_found(
    posture, fake_optimiser, make_context, catalogue
):
    part = catalogue.load("bearing_cover")
    context = make_context(part, seed=4, settings=settings_of(model_posture=posture))
    search = PalmPoseOptimiser(context)
    adapted = []
    adaption = search.adaption
    search.adaption = lambda *arguments: adapted.append(adaption(*arguments)) or adapted[-1]
    search.adaption.T_palm_face = adaption.T_palm_face
    proposals = search.propose(12)
    search.tell(proposals)

    optimiser = search._optimiser
    assert_allclose(proposals.X, optimiser.asked[0], atol=0.0)
    attempts, owner = adapted[0].attempts, adapted[0].proposal
    weight = context.settings.hpp.volume_weight
    face_height = context.T_palm_face[2, 3]
    for k in range(12):
        best, value = best_of(attempts, np.flatnonzero(owner == k), weight)
        assert proposals.best[k] == best
        assert proposals.values[k] == pytest.approx(value if best >= 0 else 0.0, rel=1e-14)
        if best >= 0:
            T = attempts.T_object_palm[best].copy()
            T[:3, 3] += face_height * T[:3, 2]
            assert_allclose(proposals.T_object_face[k], T, atol=1e-15)
        if best >= 0 and posture:
            found = [*attempts.preshape[best], adapted[0].standoff[best]]
            assert_allclose(proposals.posture[k], found, atol=0.0)
    assert np.any(proposals.values > 0.05)
    [(X, y, features)] = optimiser.told
    assert_allclose(X, proposals.X, atol=0.0)
    assert_allclose(y, proposals.values, atol=0.0)
    expected = search.space.features_of(proposals.T_object_face, proposals.posture)
    assert_allclose(features, expected, atol=0.0)
    assert features.shape == (12, 14 if posture else 12)


def test_the_papers_form_tells_the_pose_itself(fake_optimiser, make_context, sphere):
    settings = settings_of(model_sees="proposed", model_posture=False, improvement="best")
    context = make_context(sphere, settings=settings)
    search = PalmPoseOptimiser(context)
    proposals = search.propose(3)
    search.tell(proposals)
    features = search._optimiser.told[0][2]
    T = proposals.T_object_face
    assert_allclose(features[:, :3], T[:, :3, 3], atol=1e-14)
    assert_allclose(np.sqrt(2.0) * features[:, 3:].reshape(3, 3, 3), T[:, :3, :3], atol=1e-14)
    assert search._optimiser.options["to_beat"] is None
    assert proposals.X.shape == (3, 6)


def test_a_proposal_without_a_free_hand_is_told_as_zero_where_it_was_proposed(
    fake_optimiser, make_context, sphere, recording_evaluator
):
    # 5 seeds each: none of the first proposal's and all of the second's come free.
    evaluator = recording_evaluator(free=lambda n: np.arange(n) >= 5)
    context = make_context(sphere, settings=settings_of(), evaluator=evaluator)
    search = PalmPoseOptimiser(context)
    proposals = search.propose(2)
    assert proposals.best.tolist() == [-1, 0]
    assert proposals.values.tolist() == [0.0, 0.1]
    assert_allclose(proposals.T_object_face[0], search.space.poses(proposals.X)[0], atol=0.0)
    none = recording_evaluator(free=lambda n: np.zeros(n, dtype=bool))
    search = PalmPoseOptimiser(make_context(sphere, settings=settings_of(), evaluator=none))
    proposals = search.propose(2)
    search.tell(proposals)
    assert proposals.best.tolist() == [-1, -1]
    assert proposals.values.tolist() == [0.0, 0.0]
    assert none.n_attempts == 0


def test_every_attempt_goes_into_the_archive(
    fake_optimiser, make_context, sphere, recording_evaluator
):
    evaluator = recording_evaluator(figures=lambda T, spread: 0.01 + 0.001 * spread[:, 0])
    context = make_context(sphere, settings=settings_of(batch=3), evaluator=evaluator)
    search = PalmPoseOptimiser(context)
    search.step()
    search.step()
    assert evaluator.n_attempts == 2 * 3 * 5
    assert len(context.archive) == 2 * 3 * 5
    largest = max(0.01 + 0.001 * spread.max() for _, spread in evaluator.attempts)
    assert context.archive.best_epsilon == pytest.approx(largest, rel=1e-15)


@pytest.mark.parametrize(("n_initial", "n_iter", "batch"), [(5, 4, 4), (3, 0, 2), (1, 1, 64)])
def test_n_iter_ends_the_search_exactly(
    n_initial, n_iter, batch, fake_optimiser, make_context, sphere, recording_evaluator
):
    settings = settings_of(n_initial=n_initial, n_iter=n_iter, batch=batch)
    context = make_context(sphere, settings=settings, evaluator=recording_evaluator())
    search = PalmPoseOptimiser(context)
    while not search.finished:
        search.step()
    asked = [len(X) for X in search._optimiser.asked]
    assert sum(asked) == search.iterations == n_initial + n_iter
    assert max(asked) <= batch


def test_the_start_is_a_latin_hypercube_of_the_whole_space(make_context, sphere):
    settings = settings_of(n_initial=16, batch=8, model_posture=False)
    context = make_context(sphere, settings=settings)
    search = PalmPoseOptimiser(context)
    X = np.concatenate([search.propose(8).X, search.propose(8).X])
    domain = PalmSearchSpace(sphere.mesh.bounds, settings.hpp.palm_clearance_m).domain
    unit = (X - domain.lower) / (domain.upper - domain.lower)
    strata = np.sort(np.floor(16 * unit).astype(int), axis=0)
    assert np.array_equal(strata, np.tile(np.arange(16)[:, None], (1, 6)))


def test_the_same_seed_asks_the_same_and_another_does_not(make_context, sphere):
    def proposed(seed):
        search = PalmPoseOptimiser(
            make_context(sphere, seed=seed, settings=settings_of(n_initial=4, batch=4))
        )
        search.step()
        return search.propose(4).X

    first, again, other = proposed(11), proposed(11), proposed(12)
    assert np.array_equal(first, again)
    assert not np.any(np.isclose(first, other).all(axis=1))
