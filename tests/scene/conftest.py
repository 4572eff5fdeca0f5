"""Parts, evaluators and an independent judge of distances for the tests of the scene."""

from __future__ import annotations

from functools import lru_cache

import coal
import numpy as np
import pytest
import trimesh

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.transforms import transform
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.hand.kinematics import link_transforms
from gpis_grasp_planner.hand.settings import DEFAULT_HAND
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.context import palm_face_height

FRICTION = Friction(0.5, 0.4)


def _solid(name: str, shape: trimesh.Trimesh) -> Part:
    mesh = TriangleMesh(
        np.asarray(shape.vertices, dtype=float), np.asarray(shape.faces, dtype=np.int32)
    )
    return Part(name, mesh, np.asarray(shape.center_mass), 0.2, float(shape.volume), True)


SOLIDS = {
    "ball": lambda: trimesh.creation.icosphere(subdivisions=3, radius=0.03),
    "marble": lambda: trimesh.creation.icosphere(subdivisions=3, radius=0.008),
    "box": lambda: trimesh.creation.box((0.05, 0.06, 0.08)),
    "plate": lambda: trimesh.creation.box((0.12, 0.08, 0.002)),
    "rod": lambda: trimesh.creation.cylinder(radius=0.0015, height=0.2, sections=16),
    "walled box": lambda: trimesh.util.concatenate(
        [
            trimesh.creation.box((0.05, 0.06, 0.08)),
            trimesh.creation.box((0.4, 0.4, 0.01), transform(np.eye(3), [0.0, 0.0, -0.17])),
        ]
    ),
    "cylinder": lambda: trimesh.creation.cylinder(radius=0.025, height=0.1, sections=48),
}


class Scene:
    """A part with its evaluator, and distances by the library coal (right to 1e-6 m)."""

    def __init__(self, name: str, hand: str = DEFAULT_HAND):
        if name in SOLIDS:
            self.part = _solid(name, SOLIDS[name]())
        else:
            self.part = MeshCatalogue([default_catalogue_directory()]).load(name)
        self.hand = load_hand(hand)
        self.face_height = palm_face_height(self.hand)
        self.settings = SceneSettings()
        self.evaluator = CompiledEvaluator(self.hand, self.part, FRICTION, self.settings)
        self.shape = trimesh.Trimesh(self.part.mesh.vertices, self.part.mesh.faces, process=False)
        self.fingers = {
            link: index for index, finger in enumerate(self.hand.fingers) for link in finger.links
        }
        self._pieces = [
            (link, _convex(piece.vertices))
            for link, pieces in enumerate(self.hand.link_collision)
            for piece in pieces
        ]
        self._mesh = coal.BVHModelOBBRSS()
        self._mesh.beginModel(len(self.part.mesh.faces), len(self.part.mesh.vertices))
        for triangle in self.part.mesh.triangles:
            self._mesh.addTriangle(*triangle)
        self._mesh.endModel()

    def joints(self, preshape: np.ndarray) -> np.ndarray:
        """The open hand at a pre-shape (S,)."""
        q = np.zeros(self.hand.n_joints)
        q[self.hand.preshape.joints] = preshape @ self.hand.preshape.gain
        return q

    def palms(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Palms whose faces lie on random places of the surface, and the outward normals."""
        seed = int(rng.integers(2**31))
        places, faces = trimesh.sample.sample_surface(self.shape, n, seed=seed)
        normals = self.part.mesh.face_normals_outward[faces]
        x = np.cross(rng.normal(size=(n, 3)), normals)
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        R = np.stack([x, np.cross(-normals, x), -normals], axis=2)
        return transform(R, places + self.face_height * normals), normals

    def cleared(self, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Free palms at various distances, and pre-shapes (n, S)."""
        T, normals = self.palms(n, rng)
        spread = rng.choice([0.0, 0.3, 0.8, np.pi / 2, 2.4, np.pi], (n, len(self.hand.preshape)))
        spread = np.minimum(spread, self.hand.preshape.upper)
        standoff = rng.uniform(0.0, 0.08, n) * (rng.random(n) < 0.6)
        T, free = self.evaluator.clear_palm(T, normals, spread, standoff)
        return T[free], spread[free]

    def gaps(self, T: np.ndarray, joints: np.ndarray) -> np.ndarray:
        """Distances of the links from the object's surface (L,) [m]; overlaps are negative."""
        T_links = T @ link_transforms(self.hand, joints[None])[0]
        out = np.full(self.hand.n_links, np.inf)
        for link, piece in self._pieces:
            d = coal.distance(
                piece, _pose(T_links[link]), self._mesh, coal.Transform3s(),
                coal.DistanceRequest(), coal.DistanceResult(),
            )  # fmt: skip
            out[link] = min(out[link], d)
        return out

    def gap_between_fingers(self, joints: np.ndarray) -> float:
        """Smallest distance of links of different fingers, or of outer links from the palm."""
        T_links = link_transforms(self.hand, joints[None])[0]
        outwards = {link for f in self.hand.fingers for link in f.links[1:]}
        own = {link: f for f in self.hand.fingers for link in f.links}
        best = np.inf
        for i, (a, shape_a) in enumerate(self._pieces):
            for b, shape_b in self._pieces[i + 1 :]:
                fa, fb = self.fingers.get(a, -1), self.fingers.get(b, -1)
                if fa == fb:
                    continue
                if min(fa, fb) < 0:
                    moving, fixed = (a, b) if fa >= 0 else (b, a)
                    if moving not in outwards or own[moving].knuckle_link == fixed:
                        continue
                d = coal.distance(
                    shape_a, _pose(T_links[a]), shape_b, _pose(T_links[b]),
                    coal.DistanceRequest(), coal.DistanceResult(),
                )  # fmt: skip
                best = min(best, d)
        return best


def _convex(vertices: np.ndarray) -> coal.ConvexBase:
    points = coal.StdVec_Vec3s()
    for v in vertices:
        points.append(np.array(v, dtype=float))
    return coal.Convex.convexHull(points, False, "Qt")


def _pose(T: np.ndarray) -> coal.Transform3s:
    return coal.Transform3s(T[:3, :3], T[:3, 3])


@pytest.fixture(scope="session")
def scene():
    """Scenes by name, made once: solids of this file or shipped parts."""
    return lru_cache(maxsize=None)(Scene)
