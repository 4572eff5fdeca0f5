"""Alg. 2: seeds on the chart, palms against the normal, the ladder until the hand is free."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.errors import MeshError
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.open_hand import open_postures
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.search.local_adaption import LocalAdaption, palm_against
from gpis_grasp_planner.search.settings import AdaptionSettings

N_PROPOSALS = 7
FAVOURITES = np.array([0.0, np.pi / 6, np.pi / 3, np.pi / 2])


@pytest.fixture
def proposals(rng):
    """Poses of the palm's face round the ball, turned at random."""
    direction = rng.standard_normal((N_PROPOSALS, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return transform(Rotation.random(N_PROPOSALS, rng=rng).as_matrix(), 0.1 * direction)


@pytest.fixture
def adapt(sphere, make_context, recording_evaluator, proposals, rng):
    """Run the adaption with a recording evaluator: (adapted, evaluator, context)."""

    def run(settings=None, posture=None, **evaluator_options):
        evaluator = recording_evaluator(**evaluator_options)
        settings = PlannerSettings(adaption=settings or AdaptionSettings())
        context = make_context(sphere, settings=settings, evaluator=evaluator)
        return LocalAdaption.of(context)(proposals, rng, posture), evaluator, context

    return run


def expected_charts(context, proposals):
    """Centre and outward normal of each proposal's chart, by brute force over the atlas."""
    points = context.atlas.points
    centers, normals = [], []
    for T in proposals:
        nearest = points[np.argmin(np.linalg.norm(points - T[:3, 3], axis=1))]
        gradient = context.atlas.surface.gradient(nearest[None])[0]
        centers.append(nearest)
        normals.append(gradient / np.linalg.norm(gradient))
    return np.array(centers), np.array(normals)


def test_palm_is_turned_against_the_normal_by_the_smallest_rotation(rng):
    R = Rotation.random(300, rng=rng).as_matrix()
    normal = rng.standard_normal((300, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    turned = palm_against(R, normal)
    assert_allclose(turned[:, :, 2], -normal, atol=1e-14)
    assert_allclose(np.linalg.det(turned), 1.0, rtol=1e-13)
    # No rotation between two directions is smaller than the angle between them.
    magnitude = (Rotation.from_matrix(turned) * Rotation.from_matrix(R).inv()).magnitude()
    angle = np.arccos(np.clip(-np.einsum("ni,ni->n", R[:, :, 2], normal), -1.0, 1.0))
    assert_allclose(magnitude, angle, atol=1e-7)


def test_an_aligned_palm_stays_and_an_opposite_one_turns_by_half_a_turn(rng):
    R = Rotation.random(rng=rng).as_matrix()
    assert_allclose(palm_against(R, -R[:, 2]), R, atol=1e-14)
    turned = palm_against(R, R[:, 2])
    assert_allclose(turned[:, 2], -R[:, 2], atol=1e-14)
    assert_allclose(np.trace(turned @ R.T), -1.0, atol=1e-13)


@pytest.mark.parametrize("angle", [1e-13, 1e-9, np.pi - 1e-9, np.pi - 1e-13])
def test_nearly_parallel_and_nearly_opposite_normals(angle, rng, oracle):
    R = Rotation.random(rng=rng).as_matrix()
    normal = -oracle.rotation_about(R[:, 0], angle) @ R[:, 2]
    assert_allclose(palm_against(R, normal)[:, 2], -normal, atol=1e-11)


def test_every_seed_lies_on_its_chart_with_the_palm_against_the_normal(adapt, proposals):
    settings = AdaptionSettings(n_seed=9, chart_radius_ratio=0.3)
    _, evaluator, context = adapt(settings)
    [(T, normals, _, _)] = evaluator.cleared
    centers, expected = expected_charts(context, proposals)
    owner = np.repeat(np.arange(N_PROPOSALS), 9)
    assert_allclose(normals, expected[owner], atol=1e-12)
    assert_allclose(T[:, :3, 2], -normals, atol=1e-12)
    assert_allclose(T[:, :3, :3], palm_against(proposals[:, :3, :3], expected)[owner], atol=1e-12)
    on_chart = (T @ context.T_palm_face)[:, :3, 3] - centers[owner]
    assert_allclose(np.einsum("ni,ni->n", on_chart, normals), 0.0, atol=1e-12)
    radius = np.linalg.norm(on_chart, axis=1).reshape(N_PROPOSALS, 9)
    assert_allclose(radius[:, 0], 0.0, atol=1e-12)
    assert np.all(radius[:, 1:] > 0.0)
    assert np.all(radius <= 0.3 * context.max_radius + 1e-12)


def test_seeds_fill_the_disc_evenly(adapt):
    _, evaluator, context = adapt(AdaptionSettings(n_seed=600, chart_radius_ratio=0.5))
    [(T, _, _, _)] = evaluator.cleared
    on_chart = (T @ context.T_palm_face)[:, :3, 3].reshape(N_PROPOSALS, 600, 3)
    radius = np.linalg.norm(on_chart - on_chart[:, :1], axis=2)[:, 1:].ravel()
    share = np.mean(radius < 0.5 * 0.5 * context.max_radius)
    assert share == pytest.approx(0.25, abs=0.03)


def test_without_a_radius_every_seed_is_the_charts_centre(adapt):
    _, evaluator, context = adapt(AdaptionSettings(n_seed=4, chart_radius_ratio=0.0))
    [(T, _, _, _)] = evaluator.cleared
    places = (T @ context.T_palm_face)[:, :3, 3].reshape(N_PROPOSALS, 4, 3)
    assert_allclose(places, np.repeat(places[:, :1], 4, axis=1), atol=1e-15)


def test_seeds_draw_spread_and_standoff_and_the_first_stands_back_nowhere(adapt):
    settings = AdaptionSettings(n_seed=200, standoff_share=0.6, standoff_max_m=0.05)
    _, evaluator, _ = adapt(settings)
    [(_, _, spread, standoff)] = evaluator.cleared
    assert np.all(standoff.reshape(N_PROPOSALS, -1)[:, 0] == 0.0)
    assert np.all((standoff >= 0.0) & (standoff <= 0.05))
    assert np.mean(standoff > 0.0) == pytest.approx(0.6, abs=0.05)
    assert np.all((spread >= 0.0) & (spread <= np.pi))
    assert np.mean(np.isin(spread, FAVOURITES)) == pytest.approx(0.5, abs=0.05)
    assert np.ptp(spread) > 0.9 * np.pi


def test_spreads_keep_the_settings_limit(adapt):
    _, evaluator, _ = adapt(AdaptionSettings(n_seed=50, spread_max_deg=40.0))
    spread = evaluator.cleared[0][2]
    assert spread.max() <= np.deg2rad(40.0) + 1e-15
    assert spread.max() > np.deg2rad(39.0)


def test_seeds_keep_near_a_proposed_posture_and_the_first_is_it(adapt, rng):
    settings = AdaptionSettings(n_seed=40, free_share=0.0)
    posture = np.column_stack(
        [rng.uniform(0.0, np.pi, N_PROPOSALS), rng.uniform(0.0, 0.09, N_PROPOSALS)]
    )
    _, evaluator, _ = adapt(settings, posture=posture)
    spread, standoff = (a.reshape(N_PROPOSALS, 40) for a in evaluator.cleared[0][2:])
    assert_allclose(np.stack([spread[:, 0], standoff[:, 0]], axis=1), posture, atol=1e-15)
    assert np.all(np.abs(spread - posture[:, :1]) < 5 * np.deg2rad(settings.vary_spread_deg))
    assert np.all(np.abs(standoff - posture[:, 1:]) < 5 * settings.vary_standoff_m)
    assert np.all((spread >= 0.0) & (spread <= np.pi))
    assert np.all((standoff >= 0.0) & (standoff <= settings.standoff_max_m))


def test_only_free_hands_close_and_each_knows_its_proposal(adapt):
    settings = AdaptionSettings(n_seed=6)
    free = np.random.default_rng(5).random(6 * N_PROPOSALS) < 0.5
    adapted, evaluator, _ = adapt(settings, free=lambda n: free[:n])
    T, normals, spread, standoff = evaluator.cleared[0]
    T[:, :3, 3] += standoff[:, None] * normals
    [(closed, closed_spread)] = evaluator.attempts
    assert_allclose(closed, T[free], atol=0.0)
    assert_allclose(closed_spread, spread[free], atol=0.0)
    assert np.array_equal(adapted.proposal, np.repeat(np.arange(N_PROPOSALS), 6)[free])
    assert_allclose(adapted.standoff, standoff[free], atol=0.0)
    assert_allclose(adapted.attempts.T_object_palm, closed, atol=0.0)


def test_no_free_hand_is_no_attempt(adapt):
    adapted, evaluator, _ = adapt(free=lambda n: np.zeros(n, dtype=bool))
    assert len(adapted.attempts) == len(adapted.proposal) == evaluator.n_attempts == 0


class NoCharts:
    """An atlas on which some charts have no tangent plane."""

    def __init__(self, atlas, flat):
        self._atlas, self._flat = atlas, flat

    def nearest(self, points):
        return self._atlas.nearest(points)

    def chart(self, index):
        if index in self._flat:
            raise MeshError("no gradient")
        return self._atlas.chart(index)


@pytest.mark.parametrize("n_flat", [1, N_PROPOSALS])
def test_a_place_without_a_chart_is_passed_over(
    n_flat, sphere, make_context, recording_evaluator, proposals, rng
):
    evaluator = recording_evaluator()
    context = make_context(sphere, evaluator=evaluator)
    index, _ = context.atlas.nearest(proposals[:, :3, 3])
    atlas = NoCharts(context.atlas, set(index[:n_flat].tolist()))
    settings = AdaptionSettings(n_seed=3)
    adaption = LocalAdaption(
        evaluator, atlas, context.T_palm_face, context.max_radius, settings, context.preshapes
    )
    adapted = adaption(proposals, rng)
    assert np.array_equal(adapted.proposal, np.repeat(np.arange(n_flat, N_PROPOSALS), 3))


def test_destination_is_the_first_seeds_palm_on_the_surface(adapt, proposals):
    _, evaluator, context = adapt(AdaptionSettings(n_seed=1))
    faces = evaluator.cleared[0][0] @ context.T_palm_face
    destination = LocalAdaption.of(context).destination(proposals)
    angle = Rotation.from_matrix(
        np.swapaxes(destination[:, :3, :3], 1, 2) @ faces[:, :3, :3]
    ).magnitude()
    assert_allclose(destination[:, :3, 3], faces[:, :3, 3], atol=1e-12)
    # The fit's normals are those of the gradient up to its accuracy.
    assert np.all(angle < np.deg2rad(5.0))


@pytest.fixture
def cleared(sphere, make_context, proposals, planner):
    """Open hands on the ball's charts and where the ladder takes them, without standoff."""
    context = make_context(sphere)
    centers, normals = expected_charts(context, proposals)
    R = palm_against(proposals[:, :3, :3], normals)
    height = context.T_palm_face[2, 3]
    # From inside the ball: the palm's face 2 cm below the surface.
    T = transform(R, centers + (height - 0.02) * normals)
    spread = np.linspace(0.0, np.pi, N_PROPOSALS)[:, None]
    moved, free = context.evaluator.clear_palm(T, normals, spread, np.zeros(N_PROPOSALS))
    return context, T, normals, spread, moved, free


def opened(planner, spread):
    return open_postures(planner.hand, spread[None])[0]


def test_the_ladder_moves_along_the_normal_only(cleared):
    context, T, normals, _, moved, free = cleared
    assert free.all()
    step = moved[:, :3, 3] - T[:, :3, 3]
    level = np.einsum("ni,ni->n", step, normals)
    assert_allclose(moved[:, :3, :3], T[:, :3, :3], atol=1e-15)
    assert_allclose(step, level[:, None] * normals, atol=1e-12)
    # The plane of the palm's face touches the ball where the chart does, 2 cm above the start;
    # a hand whose open fingers or knuckles touch first ends higher.
    assert np.all(level > 0.019)
    assert np.all(level < context.settings.scene.lambda_max_m)


def test_the_ladder_ends_free_and_at_most_a_gap_away(cleared, planner, sphere, oracle):
    context, _, normals, spread, moved, _ = cleared
    gap = context.settings.scene.closing_gap_m
    for k in range(N_PROPOSALS):
        joints = opened(planner, spread[k])
        pieces = [p for link in oracle.posed_links(planner.hand, moved[k], joints) for p in link]
        assert not any(oracle.convex_overlap(p, sphere.mesh.vertices) for p in pieces)
        # Ten gaps nearer, the hand runs into the ball.
        nearer = [p - 10.0 * gap * normals[k] for p in pieces]
        assert any(oracle.convex_overlap(p, sphere.mesh.vertices) for p in nearer)


def test_a_standoff_is_added_to_the_ladders_end(cleared):
    context, T, normals, spread, moved, _ = cleared
    standoff = np.linspace(0.0, 0.06, N_PROPOSALS)
    further, free = context.evaluator.clear_palm(T, normals, spread, standoff)
    assert free.all()
    assert_allclose(further[:, :3, 3] - moved[:, :3, 3], standoff[:, None] * normals, atol=1e-12)


def test_a_free_hand_stays_where_it_is(cleared):
    context, _, normals, spread, moved, _ = cleared
    away = moved.copy()
    away[:, :3, 3] += 0.03 * normals
    stayed, free = context.evaluator.clear_palm(away, normals, spread, np.zeros(N_PROPOSALS))
    assert free.all()
    assert_allclose(stayed, away, atol=1e-15)


def test_lambda_keeps_its_limit_and_the_hand_turns_instead(oracle, make_context, rng):
    # Inside a long tube: along its axis the walls stay, so that lambda reaches its limit.
    tube = oracle.make_part(
        "tube", trimesh.creation.annulus(r_min=0.05, r_max=0.08, height=0.5, sections=24)
    )
    settings = PlannerSettings.from_mapping(
        {"scene": {"lambda_max_m": 0.05, "theta_step_deg": 40.0}}
    )
    context = make_context(tube, settings=settings)
    n = 24
    normals = rng.standard_normal((n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    R = palm_against(Rotation.random(n, rng=rng).as_matrix(), normals)
    T = transform(R, rng.uniform(-0.07, 0.07, (n, 3)) * [1.0, 1.0, 3.5])
    moved, free = context.evaluator.clear_palm(T, normals, np.full((n, 1), 0.5), np.zeros(n))
    level = np.einsum("ni,ni->n", moved[:, :3, 3] - T[:, :3, 3], normals)
    step = settings.scene.lambda_step_m
    assert np.all(level < 0.05 + step)
    angle = Rotation.from_matrix(np.swapaxes(R, 1, 2) @ moved[:, :3, :3]).as_rotvec()
    assert_allclose(angle[:, :2], 0.0, atol=1e-12)
    steps = np.mod(np.rad2deg(angle[:, 2]), 360.0) / 40.0
    assert_allclose(steps, np.round(steps), atol=1e-6)
    assert np.any(np.round(steps) % 9 != 0)
    assert not free.all()
