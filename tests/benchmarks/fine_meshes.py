"""The same hands on the same surface in ever finer triangles: attempts a second, and epsilon.

Once on all triangles, and, of a mesh that is simplified when it is read, as the search closes them.

python tests/benchmarks/fine_meshes.py mug sphere
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np
import trimesh

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.geometry.simplification import simplify
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.search_space import PalmSearchSpace

N = 480


def hands(part):
    """Palm poses about a part and pre-shapes; not yet free of it."""
    rng = np.random.default_rng(1)
    space = PalmSearchSpace(part.mesh.bounds, 0.06)
    T, spread = space.poses(space.domain.sample(N, rng)), rng.uniform(0.0, 2.5, (N, 1))
    T[:, :3, 3] = 0.3 * T[:, :3, 3] - 0.08 * T[:, :3, 2]
    return T, spread


def measure(part, most):
    """One row a mesh: as it is, then each triangle in four, until there are `most`."""
    hand, field, T = load_hand(), None, None
    mesh = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False)
    start, spread = hands(part)
    while len(mesh.faces) <= most:
        finer = TriangleMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32))
        own = replace(part, mesh=finer)
        evaluator = CompiledEvaluator(hand, own, Friction(0.6, 0.6), SceneSettings(), field)
        field = evaluator.field
        if T is None:
            T, _ = evaluator.clear_palm(start, -start[:, :3, 2], spread, np.zeros(N))
        row(part.mesh_id, f"{len(finer.faces):,}", evaluator, T, spread)
        if len(finer.faces) > CatalogueSettings().simplify_above_faces:
            found = simplify(finer)
            if found is not None:
                coarse = CompiledEvaluator(
                    *(hand, own, Friction(0.6, 0.6), SceneSettings(), field),
                    TriangleTree.of(found.mesh),
                )
                size = (
                    f"of it, for the search: {len(found.mesh.faces):,}, "
                    f"{1e3 * found.deviation:.3f} mm apart"
                )
                row(part.mesh_id, size, coarse, T, spread)
        mesh = mesh.subdivide()


def row(mesh_id, size, evaluator, T, spread):
    """Close the hands three times; the least processor time counts."""
    best = np.inf
    for _ in range(3):
        began = time.thread_time()
        made = evaluator.attempt(T, spread)
        best = min(best, time.thread_time() - began)
    good = made.epsilon > 0.0
    epsilon = np.where(good, made.epsilon, 0.0).mean()
    cells = (
        f"{mesh_id} | {size} | {N / best:.0f} | {good.sum()} | "
        f"{epsilon:.4f} | {made.n_contacts[good].mean():.1f}"
    )
    print(f"| {cells} |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="+", help="mesh IDs")
    parser.add_argument("--most", type=int, default=1_500_000, help="triangles")
    arguments = parser.parse_args()
    print(f"| part | triangles | attempts a second | closure of {N} | mean epsilon | contacts |")
    print("|---|---|---|---|---|---|")
    catalogue = MeshCatalogue([default_catalogue_directory()])
    for name in arguments.parts:
        measure(catalogue.load(name), arguments.most)


if __name__ == "__main__":
    main()
