"""Draw the pictures of docs/concepts.md with the planner's own code, as SVG.

Usage: python scripts/draw_concepts.py [FOLDER]        (docs/images without it)
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.plan.request import PlanRequest

Array = NDArray[np.float64]

FRICTION = 0.5
BLUE, RED, GREY, PART = "#2a6fb0", "#c0392b", "#777777", "#f2dca0"


def wrench_space(folder: Path) -> None:
    """Three contacts of a disc in the plane, and the hull of what they can apply."""
    angles = np.radians([100.0, 215.0, 325.0])
    positions = np.column_stack([np.cos(angles), np.sin(angles)])
    inward = -positions
    tangents = np.column_stack([-inward[:, 1], inward[:, 0]])
    edges = np.stack([inward + FRICTION * tangents, inward - FRICTION * tangents], axis=1)
    torques = positions[:, None, 0] * edges[..., 1] - positions[:, None, 1] * edges[..., 0]
    wrenches = np.concatenate([edges, torques[..., None]], axis=2).reshape(-1, 3)
    hull = ConvexHull(wrenches)
    facet = int(np.argmin(-hull.equations[:, -1]))
    epsilon, weakest = -hull.equations[facet, -1], hull.equations[facet, :3]

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 4.0), layout="constrained")
    left.add_patch(plt.Circle((0, 0), 1.0, color=PART))
    for p, cone in zip(positions, edges, strict=True):
        left.fill(*np.vstack([p, p + 0.6 * cone]).T, color=RED, alpha=0.3, lw=0)
        left.plot(*np.vstack([p + 0.6 * cone[0], p, p + 0.6 * cone[1]]).T, color=RED)
        left.plot(*p, "o", color=RED)
    left.annotate("friction cone", positions[0] + [0.1, -0.5], [0.75, 1.15], arrowprops=_ARROW)
    left.annotate("contact", positions[2], [1.1, -1.15], arrowprops=_ARROW)
    left.set_title("three contacts of a disc")
    left.set(xlim=(-1.5, 1.9), ylim=(-1.4, 1.4), aspect="equal")
    left.axis("off")

    # What is seen along the third axis of a frame with the weakest direction in it.
    across = np.array([0.0, 0.0, 1.0]) if abs(weakest[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    u = weakest
    v = across - (across @ u) * u
    v /= np.linalg.norm(v)
    seen = wrenches @ np.column_stack([u, v])
    outline = seen[ConvexHull(seen).vertices]
    right.fill(*outline.T, color=BLUE, alpha=0.15, lw=0)
    right.plot(*np.vstack([outline, outline[:1]]).T, color=BLUE)
    right.plot(*seen.T, "o", color=RED)
    right.add_patch(plt.Circle((0, 0), epsilon, fill=False, color=GREY, ls="--"))
    right.annotate("", [epsilon, 0.0], [0.0, 0.0], arrowprops={"arrowstyle": "->", "color": RED})
    right.text(0.5 * epsilon, 0.05, "epsilon", color=RED, ha="center")
    right.annotate("edges of the cones", seen[0], [0.2, 1.25], arrowprops=_ARROW)
    right.plot(0, 0, "+", color="black")
    right.set_title("hull of their wrenches")
    right.set(xlabel="weakest wrench", ylabel="a wrench across it", aspect="equal")
    right.set(ylim=(-1.3, 1.45))
    right.spines[["top", "right"]].set_visible(False)
    _save(figure, folder / "wrench_space.svg")


def implicit_surface(folder: Path) -> None:
    """A section of the mug through its fitted surface: level sets, and what is not known."""
    part = MeshCatalogue([default_catalogue_directory()]).load("mug")
    surface = GraspPlanner().prepare(part).atlas.surface
    low, high = part.mesh.bounds
    margin = 0.02
    x = np.linspace(low[0] - margin, high[0] + margin, 220)
    z = np.linspace(low[2] - margin, high[2] + margin, 220)
    points = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    value = 1e3 * surface.value(points).reshape(len(x), len(z)).T
    deviation = 1e3 * np.sqrt(surface.variance(points)).reshape(len(x), len(z)).T
    near = np.abs(surface.points[:, 1]) < 0.004

    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.4), layout="constrained")
    drawn = left.contourf(
        1e3 * x, 1e3 * z, value, levels=np.arange(-8, 25, 4), cmap="RdBu_r", extend="both",
        norm=mpl.colors.TwoSlopeNorm(0.0, -8.0, 24.0),
    )  # fmt: skip
    drawn.set_rasterized(True)  # as paths it is a megabyte
    left.contour(1e3 * x, 1e3 * z, value, levels=[0.0], colors="black", linewidths=1.8)
    figure.colorbar(drawn, ax=left, label="f [mm], 0 on the surface", shrink=0.65)
    left.set_title("mean: a distance")
    drawn = right.contourf(1e3 * x, 1e3 * z, deviation, levels=12, cmap="Greys")
    drawn.set_rasterized(True)
    right.contour(1e3 * x, 1e3 * z, value, levels=[0.0], colors="black", linewidths=1.2)
    right.plot(*(1e3 * surface.points[near][:, [0, 2]]).T, ".", color=RED, ms=3, label="samples")
    figure.colorbar(drawn, ax=right, label="standard deviation [mm]", shrink=0.65)
    right.legend(loc="upper right")
    right.set_title("what is not known")
    for axes in (left, right):
        axes.set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal")
    _save(figure, folder / "gpis_section.svg")


def search(folder: Path) -> None:
    """Epsilon of the best grasp of the mug after so many attempts, with a model and by chance."""
    part = MeshCatalogue([default_catalogue_directory()]).load("mug")
    figure, axes = plt.subplots(figsize=(7.0, 3.6), layout="constrained")
    for planner, colour in (("dual", BLUE), ("random", GREY)):
        request = PlanRequest(
            planner=planner, seed=0, max_evaluations=2000, time_budget_s=120.0, verification="none"
        )
        result = GraspPlanner().plan(part, request)
        steps = np.array(result.convergence)[:, 1:]
        steps = np.vstack([steps, [result.evaluations, steps[-1, 1]]])
        axes.step(*steps.T, where="post", color=colour, label=planner)
    axes.set(xlabel="attempts", ylabel="epsilon of the best grasp", ylim=(0.0, None))
    axes.legend(loc="lower right")
    axes.set_title("the mug, seed 0")
    axes.spines[["top", "right"]].set_visible(False)
    _save(figure, folder / "search_progress.svg")


_ARROW = {"arrowstyle": "-", "color": GREY}


def _save(figure: plt.Figure, file: Path) -> None:
    figure.savefig(file, metadata={"Date": None})
    plt.close(figure)
    print(file)


def main() -> None:
    """Draw all."""
    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "concepts", "font.size": 10})
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?", default=Path("docs/images"))
    folder = parser.parse_args().folder
    for draw in (wrench_space, implicit_surface, search):
        draw(folder)


if __name__ == "__main__":
    main()
