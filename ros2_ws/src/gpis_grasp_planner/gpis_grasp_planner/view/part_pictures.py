"""Pictures of a part with what a plan or its model says of it: lost palms, surface errors."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import apply
from gpis_grasp_planner.surface.implicit_surface import ImplicitSurface
from gpis_grasp_planner.view.camera import VIEWS, look_from
from gpis_grasp_planner.view.grasp_scene import GraspScene
from gpis_grasp_planner.view.legend import with_caption, with_legend
from gpis_grasp_planner.view.lost_palm_colors import PaintedPalms, painted_palms
from gpis_grasp_planner.view.picture import AROUND_COLOR, OBJECT_COLOR
from gpis_grasp_planner.view.renderer import Body, Scene
from gpis_grasp_planner.view.shapes import ellipsoid

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

_ANSWERED: tuple[int, int, int] = (20, 160, 70)
_BALL_SHARE, _BALL_CORNERS = 0.008, 42  # of the picture's diagonal
_ERROR_BINS = 9
_FINE_SHARE = 1.0 / 40.0  # of the part's diagonal: edges of the triangles that are coloured


def lost_palms_picture(
    scene: GraspScene, *, caption: str = "", size: tuple[int, int] = (1000, 750)
) -> Pixels:
    """The part in its place, a ball for each lost palm and each answered one, and a legend.

    The legend makes the picture wider than `size`. About 2 s.
    """
    T = scene.place.T_world_object
    answered = np.array([grasp.T_object_palm[:3, 3] for grasp in scene.grasps if grasp.feasible])
    painted = painted_palms(scene.lost_palms, scene.funnel)
    if len(answered):
        painted.append(PaintedPalms(f"answered ({len(answered)})", _ANSWERED, answered))
    part = TriangleMesh(apply(T, scene.part.mesh.vertices), scene.part.mesh.faces)
    palms = [apply(T, np.unique(palms.positions, axis=0)) for palms in painted]
    points = np.vstack([part.vertices, *palms])
    radius = _BALL_SHARE * float(np.linalg.norm(np.ptp(points, axis=0)))
    bodies = [Body(part, OBJECT_COLOR)]
    bodies += [Body(mesh, AROUND_COLOR) for mesh in scene.surroundings().values()]
    bodies += [
        Body(_balls(positions, radius), _unit_color(palms.color), marker=True)
        for palms, positions in zip(painted, palms, strict=True)
    ]
    camera = look_from(VIEWS["iso"], points, size[0] / size[1])
    with Scene(bodies) as drawn:
        pixels = drawn.render(camera, *size)
    title = "Palms of hands that were lost,\nsome of each cause:"
    entries = [(palms.color, palms.label) for palms in painted]
    return with_legend(with_caption(pixels, caption) if caption else pixels, title, entries)


def surface_error_picture(
    part: Part, surface: ImplicitSurface, *, size: tuple[int, int] = (1000, 750)
) -> Pixels:
    """The mesh, coloured by how far the implicit surface is from it, and a legend.

    The error is f over the length of its gradient at the middle of each triangle, of edges of at
    most a fortieth of the part's diagonal: the distance to first order, positive where the mesh
    lies outside of the implicit surface.
    """
    mesh = _subdivided(part.mesh, _FINE_SHARE * part.mesh.diagonal)
    corners = mesh.vertices[mesh.faces]
    value, gradient = surface.value_and_gradient(corners.mean(axis=1))
    error_mm = 1e3 * value / np.maximum(np.linalg.norm(gradient, axis=1), 1e-6)
    most = max(float(np.quantile(np.abs(error_mm), 0.99)), 1e-3)
    edges = np.linspace(-most, most, _ERROR_BINS + 1)
    number = np.clip(np.digitize(error_mm, edges) - 1, 0, _ERROR_BINS - 1)
    colors = [_from_blue_to_red(share) for share in np.linspace(-1.0, 1.0, _ERROR_BINS)]
    bodies = [
        Body(_with_faces(mesh, number == k), _unit_color(color))
        for k, color in enumerate(colors)
        if (number == k).any()
    ]
    camera = look_from(VIEWS["iso"], mesh.vertices, size[0] / size[1])
    with Scene(bodies) as drawn:
        pixels = drawn.render(camera, *size)
    area = mesh.face_areas
    mean = float(np.abs(error_mm) @ area / area.sum())
    title = (
        f"{part.mesh_id}: the mesh outside (+) or\ninside (-) of the implicit surface.\n"
        f"Mean {mean:.3g} mm, largest {np.abs(error_mm).max():.3g} mm.\n \nmm:"
    )
    texts = [f"{low:+.3f} to {high:+.3f}" for low, high in pairwise(edges)]
    texts[0], texts[-1] = f"below {edges[1]:+.3f}", f"above {edges[-2]:+.3f}"
    return with_legend(pixels, title, list(zip(colors, texts, strict=True))[::-1])


def _balls(centers: Array, radius: float) -> TriangleMesh:
    """One mesh of balls at centres (n, 3) [m]."""
    ball = ellipsoid(np.zeros(3), np.full(3, radius), _BALL_CORNERS)
    n = len(ball.vertices)
    vertices = (centers[:, None] + ball.vertices).reshape(-1, 3)
    faces = (n * np.arange(len(centers))[:, None, None] + ball.faces).reshape(-1, 3)
    return TriangleMesh(vertices, faces)


def _subdivided(mesh: TriangleMesh, longest_m: float) -> TriangleMesh:
    """Triangles cut in four until no edge is longer; neighbours need not meet in vertices."""
    todo, done = mesh.vertices[mesh.faces], []
    while len(todo):
        edges = np.linalg.norm(todo - np.roll(todo, 1, axis=1), axis=2)
        large = edges.max(axis=1) > longest_m
        done.append(todo[~large])
        a, b, c = np.moveaxis(todo[large], 1, 0)
        ab, bc, ca = (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0
        quarters = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        todo = np.concatenate([np.stack(corners, axis=1) for corners in quarters])
    corners = np.concatenate(done)
    faces = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return TriangleMesh(corners.reshape(-1, 3), faces)


def _with_faces(mesh: TriangleMesh, kept: NDArray[np.bool_]) -> TriangleMesh:
    corners = mesh.vertices[mesh.faces[kept]]
    faces = np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return TriangleMesh(corners.reshape(-1, 3), faces)


def _from_blue_to_red(share: float) -> tuple[int, int, int]:
    """Of -1..1, with a light grey in the middle."""
    end = np.array([40, 80, 200]) if share < 0.0 else np.array([210, 45, 35])
    r, g, b = np.round(np.array([225, 225, 220]) * (1.0 - abs(share)) + end * abs(share))
    return int(r), int(g), int(b)


def _unit_color(color: Sequence[int]) -> tuple[float, float, float]:
    r, g, b = (value / 255.0 for value in color)
    return r, g, b
