"""Accuracy of the implicit surface against meshes: ``python -m ...surface.accuracy DIR...``.

For every mesh the zero set is sampled afresh (points of the mesh, disturbed, then Newton steps
along the gradient), and each of its points is compared with the exact nearest point of the mesh:
the distance, and the angle between the gradient and the normal of the nearest face. The angle
leaves out points nearer than 1 % of the diagonal to a sharp edge (faces at 30 degrees or more),
as no normal is right there.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import GraspPlannerError
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory, load_part
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.surface_samples import near_sharp_edge, uniform_samples
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.surface.chart import project
from gpis_grasp_planner.surface.implicit_surface import fit_part
from gpis_grasp_planner.surface.settings import SurfaceSettings

Array = NDArray[np.float64]

MESH_SUFFIXES = (".stl", ".obj", ".ply", ".off")
EDGE_MARGIN = 0.01
DISTURBANCE = 0.003


@dataclass(frozen=True)
class Accuracy:
    """What :func:`measure` found for one mesh; distances in metres, angles in degrees.

    `fit_s` (sampling included) and `evaluation_us` are processor time of one thread, so that
    other processes on the machine do not enter. `values_at_mesh` is the absolute value of f at
    points of the mesh itself, the other direction of the comparison.
    """

    n_samples: int
    n_patches: int
    diagonal: float
    fit_s: float
    evaluation_us: float
    converged: float
    distances: Array
    angles_deg: Array
    smooth: NDArray[np.bool_]
    values_at_mesh: Array


def measure(
    mesh: TriangleMesh, settings: SurfaceSettings, seed: int = 0, n_points: int = 4000
) -> Accuracy:
    """Fit one mesh and compare the zero set with it at `n_points` fresh points."""
    begin = time.process_time()
    surface = fit_part(mesh, settings, seed)
    fit_s = time.process_time() - begin
    on_mesh = uniform_samples(mesh, n_points, seed + 1).points
    rng = np.random.default_rng([seed, 2])
    disturbed = on_mesh + DISTURBANCE * mesh.diagonal * rng.normal(size=on_mesh.shape)
    begin = time.process_time()
    surface.value_and_gradient(disturbed)
    evaluation_us = 1e6 * (time.process_time() - begin) / n_points
    x, converged = project(surface, disturbed)
    x = x[converged]
    tree = TriangleTree.of(mesh)
    _, distances, face = tree.nearest(x)
    gradient = surface.gradient(x)
    normal = tree.normals_outward[face]
    cosine = np.einsum("ij,ij->i", gradient, normal) / np.linalg.norm(gradient, axis=1)
    return Accuracy(
        n_samples=len(surface.points),
        n_patches=surface.n_patches,
        diagonal=mesh.diagonal,
        fit_s=fit_s,
        evaluation_us=evaluation_us,
        converged=float(converged.mean()),
        distances=distances,
        angles_deg=np.degrees(np.arccos(cosine.clip(-1.0, 1.0))),
        smooth=~near_sharp_edge(mesh, x, EDGE_MARGIN * mesh.diagonal),
        values_at_mesh=np.abs(surface.value(on_mesh)),
    )


def table(rows: Sequence[tuple[str, Accuracy]]) -> str:
    """A Markdown table, one line a mesh."""
    lines = [
        "| mesh | diagonal mm | samples | fit s | us/point | mean distance mm | % of diagonal "
        "| 95th percentile mm | normal median deg | \\|f\\| > 0.2 mm on the mesh |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, a in rows:
        mean = float(a.distances.mean())
        angle = f"{np.median(a.angles_deg[a.smooth]):.2f}" if a.smooth.any() else "-"
        lines.append(
            f"| {name} | {1e3 * a.diagonal:.0f} | {a.n_samples} | {a.fit_s:.2f} "
            f"| {a.evaluation_us:.1f} | {1e3 * mean:.4f} | {100.0 * mean / a.diagonal:.4f} "
            f"| {1e3 * np.percentile(a.distances, 95):.3f} | {angle} "
            f"| {100.0 * np.mean(a.values_at_mesh > 2e-4):.1f} % |"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure every mesh of some directories (in metres where no sidecar says otherwise)."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("directories", nargs="*", type=Path, metavar="DIRECTORY")
    parser.add_argument("--samples", type=int, default=SurfaceSettings().n_samples)
    parser.add_argument("--kernel", default=SurfaceSettings().kernel)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    rows: list[tuple[str, Accuracy]] = []
    try:
        settings = SurfaceSettings(n_samples=options.samples, kernel=options.kernel)
        for directory in options.directories or [default_catalogue_directory()]:
            for path in sorted(p for p in directory.iterdir() if p.suffix in MESH_SUFFIXES):
                mesh = load_part(path).mesh
                if not rows:
                    measure(mesh, settings, options.seed)  # compiles, where no cache is there yet
                rows.append((path.stem, measure(mesh, settings, options.seed)))
    except (GraspPlannerError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    sys.stdout.write(table(rows) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
