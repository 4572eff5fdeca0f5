"""Perturbed palms, sigma points and hold probabilities against direct computation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import ErrorCode, PoseError
from gpis_grasp_planner.geometry.transforms import inverse, transform
from gpis_grasp_planner.grasp.evaluator import AttemptStatus
from gpis_grasp_planner.surroundings.covariance import check_covariance, covariance_in_object
from gpis_grasp_planner.surroundings.hold_probability import (
    holds,
    perturbed_palms,
    random_perturbations,
    rank_under_uncertainty,
    sigma_points,
)
from gpis_grasp_planner.surroundings.uncertainty_settings import UncertaintySettings

NOISE = np.diag([0.005**2] * 3 + [np.deg2rad(5.0) ** 2] * 3)
# A part that stays where it is: the fingers close once, and a palm that arrives in it misses.
FIXED = {"give_way_m": 0.0, "draw_in_m": 0.0}


def random_covariance(rng):
    A = rng.standard_normal((6, 6)) * np.array([0.005] * 3 + [0.1] * 3)[:, None]
    return A @ A.T


def test_palms_are_seen_from_the_part_where_it_really_is():
    """World: the estimate, the truth beside it, the palm where the estimate sent it."""
    rng = np.random.default_rng(0)
    T_world_estimate = transform(Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3))
    T_object_palm = transform(Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3))
    in_object = rng.standard_normal((30, 6)) * 0.2
    palms = perturbed_palms(T_object_palm, in_object)
    R = T_world_estimate[:3, :3]
    for palm, x in zip(palms, in_object, strict=True):
        shift, turn = R @ x[:3], R @ x[3:]  # the same perturbation about the world's axes
        T_world_true = transform(
            Rotation.from_rotvec(turn).as_matrix() @ R, T_world_estimate[:3, 3] + shift
        )
        np.testing.assert_allclose(
            palm, inverse(T_world_true) @ T_world_estimate @ T_object_palm, atol=1e-12
        )


def test_covariance_turns_with_the_perturbations():
    rng = np.random.default_rng(1)
    C, R = random_covariance(rng), Rotation.random(rng=rng).as_matrix()
    x = rng.standard_normal((5, 6))
    turned = np.concatenate([x[:, :3] @ R, x[:, 3:] @ R], axis=1)
    # the quadratic form of a perturbation does not depend on the axes it is written in
    np.testing.assert_allclose(
        np.einsum("ni,ij,nj->n", turned, np.linalg.inv(covariance_in_object(C, R)), turned),
        np.einsum("ni,ij,nj->n", x, np.linalg.inv(C), x),
        rtol=1e-6,
    )


@pytest.mark.parametrize("kappa", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("rank", [6, 3, 0])
def test_sigma_points_have_the_mean_and_the_covariance_exactly(kappa, rank):
    C = random_covariance(np.random.default_rng(2))
    C[rank:] = 0.0
    C[:, rank:] = 0.0
    points, weights = sigma_points(C, kappa)
    assert points.shape == (13, 6)
    assert weights.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(weights @ points, np.zeros(6), atol=1e-15)
    np.testing.assert_allclose((weights * points.T) @ points, C, atol=1e-12)


def test_random_perturbations_have_the_covariance():
    C = random_covariance(np.random.default_rng(3))
    x = random_perturbations(C, 40_000, np.random.default_rng(4))
    scale = np.sqrt(np.outer(np.diag(C), np.diag(C)))
    assert np.abs(np.cov(x.T) - C).max() < 0.03 * scale.max()
    assert (np.abs(np.cov(x.T) - C) / scale).max() < 0.03


@pytest.mark.parametrize(
    ("covariance", "words"),
    [
        (np.eye(5), "shape"),
        (np.full((6, 6), np.nan), "not finite"),
        (np.eye(6) + np.eye(6, k=1), "transpose"),
        (np.diag([1.0, 1.0, -1e-3, 1.0, 1.0, 1.0]), "eigenvalue"),
    ],
)
def test_a_bad_covariance_is_refused(covariance, words):
    with pytest.raises(PoseError, match=words) as caught:
        check_covariance(covariance)
    assert caught.value.code == ErrorCode.INVALID_COVARIANCE


def test_what_counts_as_held(planner, oracle):
    hand = planner.hand
    one, two, _ = hand.fingers
    palm = hand.link_names.index(hand.palm_link)
    cases = [
        ([one.distal_link, two.distal_link], 0.1, AttemptStatus.GRASPED, True),
        ([one.distal_link, palm], 0.1, AttemptStatus.GRASPED, True),
        ([one.distal_link, one.inner_link], 0.1, AttemptStatus.GRASPED, False),
        ([palm, hand.fingers[2].knuckle_link], 0.1, AttemptStatus.GRASPED, False),
        ([one.distal_link, two.distal_link], 0.01, AttemptStatus.GRASPED, False),
        ([one.distal_link, two.distal_link], 0.1, AttemptStatus.PALM_COLLISION, False),
    ]
    attempts = oracle.make_attempts(
        np.broadcast_to(np.eye(4), (len(cases), 4, 4)), [c[1] for c in cases]
    )
    for i, (links, _, status, _) in enumerate(cases):
        attempts.links[i, :2] = links
        attempts.n_contacts[i] = 2
        attempts.status[i] = status
    assert holds(attempts, hand, 0.02).tolist() == [c[3] for c in cases]


def test_a_pose_that_is_known_exactly_holds_with_its_own_epsilon(mug_plan, planner):
    grasps = mug_plan.result.grasps[:6]
    order, estimates = rank_under_uncertainty(
        mug_plan.context.evaluator, planner.hand, grasps, np.zeros((6, 6)),
        UncertaintySettings(samples=3, min_epsilon=0.001), np.random.default_rng(0),
    )  # fmt: skip
    for grasp, estimate in zip(grasps, estimates, strict=True):
        assert estimate.probability == pytest.approx(1.0)
        # the search's epsilon is an upper bound
        assert estimate.expected_quality >= grasp.epsilon - 1e-6
        assert estimate.n == 3
        assert 0.0 < estimate.standard_error < 0.5
    quality = [estimates[i].expected_quality for i in order]
    assert quality == sorted(quality, reverse=True)


def test_probability_is_the_share_of_perturbed_attempts_that_hold(mug_plan, planner):
    grasp, settings = mug_plan.result.grasps[0], UncertaintySettings(samples=40, **FIXED)
    [_], [estimate] = rank_under_uncertainty(
        mug_plan.context.evaluator, planner.hand, [grasp], NOISE, settings,
        np.random.default_rng(5),
    )  # fmt: skip
    x = random_perturbations(NOISE, 40, np.random.default_rng(5))
    attempts = mug_plan.context.evaluator.attempt_from(
        perturbed_palms(grasp.T_object_palm, x), np.repeat(grasp.pregrasp_joints[None], 40, axis=0)
    )
    held = holds(attempts, planner.hand, settings.min_epsilon)
    assert estimate.probability == pytest.approx(held.mean())
    assert estimate.expected_quality == pytest.approx(np.where(held, attempts.epsilon, 0.0).mean())


def test_ranking_by_probability_beats_ranking_by_epsilon_on_fresh_noise(mug_plan, planner):
    """On perturbations it has not seen, and more noise never helps on the whole."""
    grasps = mug_plan.result.grasps
    evaluator, hand = mug_plan.context.evaluator, planner.hand
    fresh = UncertaintySettings(samples=48, **FIXED)
    order, _ = rank_under_uncertainty(
        evaluator, hand, grasps, NOISE, fresh, np.random.default_rng(6)
    )
    _, estimates = rank_under_uncertainty(
        evaluator, hand, grasps, NOISE, fresh, np.random.default_rng(7)
    )
    p = np.array([e.probability for e in estimates])
    print(f"seeds 6, 7: by epsilon {p[:3].mean():.2f}, by probability {p[order[:3]].mean():.2f}")
    assert p[order[:3]].mean() > p[:3].mean()
    _, calmer = rank_under_uncertainty(
        evaluator, hand, grasps, 0.04 * NOISE, fresh, np.random.default_rng(7)
    )
    assert np.mean([e.probability for e in calmer]) > p.mean()


def test_sigma_points_need_no_luck_and_agree_roughly_with_samples(mug_plan, planner):
    grasps = mug_plan.result.grasps[:10]
    run = [
        rank_under_uncertainty(
            mug_plan.context.evaluator, planner.hand, grasps, NOISE,
            UncertaintySettings(method=method, samples=64), np.random.default_rng(seed),
        )[1]
        for method, seed in (("unscented", 0), ("unscented", 1), ("sampled", 2))
    ]  # fmt: skip
    assert run[0] == run[1]
    assert {e.n for e in run[0]} == {13}
    ranks = [np.argsort(np.argsort([e.expected_quality for e in r])) for r in (run[0], run[2])]
    assert np.corrcoef(ranks)[0, 1] > 0.4


def test_a_part_that_gives_way_is_held_at_least_as_often(mug_plan, planner):
    estimates = [
        rank_under_uncertainty(
            mug_plan.context.evaluator, planner.hand, mug_plan.result.grasps[:8], NOISE,
            UncertaintySettings(samples=24, give_way_m=way, draw_in_m=drawn),
            np.random.default_rng(8),
        )[1]
        for way, drawn in ((0.0, 0.0), (0.02, 0.0), (0.02, 0.01))
    ]  # fmt: skip
    p = np.array([[e.probability for e in r] for r in estimates])
    assert (p[1] >= p[0]).all()
    assert p[1].mean() > p[0].mean()
    assert (p[2] >= p[1]).all()
    assert p[2].mean() > p[1].mean()
