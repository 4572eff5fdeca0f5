"""Simple parts and hand-made grasps whose verdicts anybody can tell."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.transforms import inverse, transform
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.open_hand import open_postures
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import HandDescription, load_hand
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator

PALM_FACE_M = 0.0793


def convex_part(points: np.ndarray, name: str = "convex") -> Part:
    """A part that is the hull of points, its centre of mass at the origin of their frame."""
    hull = ConvexHull(points)
    faces = hull.simplices.copy()
    a, b, c = (points[faces[:, i]] for i in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[inward] = faces[inward][:, ::-1]
    mesh = TriangleMesh(np.asarray(points, dtype=float), faces.astype(np.int32))
    return Part(name, mesh, np.zeros(3), 1000 * hull.volume, float(hull.volume), True)


def cylinder(radius: float, length: float, segments: int = 48) -> Part:
    """A cylinder about x."""
    angle = 2 * np.pi * np.arange(segments) / segments
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    ends = [np.column_stack([np.full(segments, x), ring]) for x in (-length / 2, length / 2)]
    return convex_part(np.concatenate(ends), "cylinder")


def box(x: float, y: float, z: float) -> Part:
    """A box about the origin with edges along the axes."""
    corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) / 2
    return convex_part(corners * [x, y, z], "box")


def grasp_at(part: Part, hand: HandDescription, center_palm: np.ndarray, spread: float) -> Grasp:
    """The grasp that AutoGrasp makes of a part whose frame is parallel to the palm's."""
    T = inverse(transform(np.eye(3), center_palm))
    closed = CompiledEvaluator(hand, part, Friction(0.6, 0.6), SceneSettings()).attempt(
        T[None], np.array([[spread]])
    )
    return Grasp(
        T_object_palm=T,
        joints=closed.joints[0],
        pregrasp_joints=open_postures(hand, np.array([[spread]]))[0],
        contacts=closed.contacts(0),
        quality=closed.quality(0),
        approach_direction=T[:3, 2],
        approach_distance=0.1,
    )


@pytest.fixture(scope="session")
def hand() -> HandDescription:
    return load_hand()


@pytest.fixture(scope="session")
def palm_face() -> float:
    """Height of the palm's face over the palm frame [m]."""
    return PALM_FACE_M


@pytest.fixture(scope="session")
def make_box() -> Callable[[float, float, float], Part]:
    """Maker of boxes by their edge lengths."""
    return box


@pytest.fixture(scope="session")
def grasp_of(hand: HandDescription) -> Callable[[Part, np.ndarray], Grasp]:
    """Maker of grasps without spread by the part's place in the palm frame."""
    return lambda part, center: grasp_at(part, hand, center, 0.0)


@pytest.fixture(scope="session")
def bar() -> Part:
    """A round bar, 60 mm thick."""
    return cylinder(0.030, 0.120)


@pytest.fixture(scope="session")
def firm(bar: Part, hand: HandDescription) -> Grasp:
    """The bar against the palm, across it, F1 and F2 against F3: a power grasp."""
    return grasp_at(bar, hand, np.array([0.0, 0.0, PALM_FACE_M + 0.0305]), 0.0)
