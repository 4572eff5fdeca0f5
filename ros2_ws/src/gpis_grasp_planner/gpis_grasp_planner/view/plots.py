"""Plots of measurements, drawn without a display."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.request import PlanResult
from gpis_grasp_planner.surface.implicit_surface import ImplicitSurface

Array = NDArray[np.float64]

_GRID = 160  # points along the longer side of a slice
_MARGIN = 0.15  # around the part, of its diagonal


def plot_convergence(
    times: ArrayLike,
    curves: Mapping[str, NDArray[np.float64]],
    *,
    path: Path,
    title: str = "",
    ylabel: str = "best epsilon",
) -> None:
    """Plot values over time per planner: the mean over seeds, and a band over all seeds.

    Parameters
    ----------
    times : (t,) array [s]
    curves : mapping of str to (seeds, t) array
        By planner, in the order of the legend.
    path : Path
        PNG or SVG, by its suffix.
    title, ylabel : str
    """
    times = np.asarray(times, dtype=float)
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    for name, values in curves.items():
        [line] = axes.plot(times, values.mean(axis=0), label=name, linewidth=1.8)
        low, high = values.min(axis=0), values.max(axis=0)
        axes.fill_between(times, low, high, color=line.get_color(), alpha=0.15, linewidth=0)
    axes.set(xlabel="time [s]", ylabel=ylabel, title=title, xlim=(0.0, times[-1]))
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right", fontsize="small")
    figure.savefig(path, dpi=120)


def plot_plan(result: PlanResult, path: Path) -> None:
    """Plot the best epsilon of one plan over time, as the steps it was found in."""
    steps = np.array([(t, best) for t, _, best in result.convergence]).reshape(-1, 2)
    end = max(result.elapsed_s, 1e-3)
    t = np.concatenate([[0.0], steps[:, 0], [end]])
    best = np.concatenate([[0.0], steps[:, 1], steps[-1:, 1] if len(steps) else [0.0]])
    figure = Figure(figsize=(7.0, 4.2), layout="constrained")
    axes = figure.subplots()
    axes.step(t, best, where="post", linewidth=1.8)
    axes.plot(steps[:, 0], steps[:, 1], "o", markersize=4)
    axes.set(
        xlabel="time [s]",
        ylabel="best epsilon of the search",
        title=f"{result.mesh_id}, {result.request.planner}: {result.evaluations} hands",
        xlim=(0.0, end),
    )
    axes.set_ylim(bottom=0.0)
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)


def plot_slice(part: Part, surface: ImplicitSurface, path: Path) -> None:
    """Plot a slice through the implicit surface's posterior: its mean, and its deviation.

    The plane goes through the middle of the part, across the axis along which it is shortest. Black
    is the zero level, orange the mesh, whose section should lie under it.
    """
    low, high = part.mesh.bounds
    across = int(np.argmin(high - low))
    u, v = (axis for axis in range(3) if axis != across)
    level = float((low + high)[across] / 2.0)
    margin = _MARGIN * part.mesh.diagonal
    step = (max(high[u] - low[u], high[v] - low[v]) + 2.0 * margin) / _GRID
    x = np.arange(low[u] - margin, high[u] + margin, step)
    y = np.arange(low[v] - margin, high[v] + margin, step)
    points = np.empty((len(y), len(x), 3))
    points[..., u], points[..., v], points[..., across] = x, y[:, None], level
    flat = points.reshape(-1, 3)
    mean_mm = 1e3 * surface.value(flat).reshape(points.shape[:2])
    deviation_mm = 1e3 * np.sqrt(surface.variance(flat)).reshape(points.shape[:2])
    section = 1e3 * _section(part.mesh, across, level)[:, :, [u, v]]
    figure = Figure(figsize=(11.0, 4.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    reach = float(max(-5.0 * mean_mm.min(), 0.1 * mean_mm.max()))  # the inside is to be seen
    drawn = left.contourf(
        1e3 * x, 1e3 * y, mean_mm, np.linspace(-reach, reach, 25), cmap="RdBu_r", extend="both"
    )
    figure.colorbar(drawn, ax=left, label="mean of f [mm]; outside positive")
    drawn = right.contourf(1e3 * x, 1e3 * y, deviation_mm, 20, cmap="viridis")
    figure.colorbar(drawn, ax=right, label="standard deviation of f [mm], an upper bound")
    for axes in (left, right):
        axes.contour(1e3 * x, 1e3 * y, mean_mm, [0.0], colors="black", linewidths=2.2)
        axes.add_collection(LineCollection(list(section), colors="orange", linewidths=0.9))
        _label(axes, "xyz"[u], "xyz"[v])
    figure.suptitle(f"{part.mesh_id}: slice at {'xyz'[across]} = {1e3 * level:.1f} mm")
    figure.savefig(path, dpi=120)


def _label(axes: Axes, horizontal: str, vertical: str) -> None:
    axes.set(xlabel=f"{horizontal} [mm]", ylabel=f"{vertical} [mm]", aspect="equal")


def _section(mesh: TriangleMesh, across: int, level: float) -> Array:
    """Where the triangles meet the plane of a coordinate, as lines (n, 2, 3) [m]."""
    corners = mesh.vertices[mesh.faces]
    height = corners[:, :, across] - level
    lines = []
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        # the corner a lies alone on its side
        alone = (height[:, a] >= 0.0) != (height[:, b] >= 0.0)
        alone &= (height[:, b] >= 0.0) == (height[:, c] >= 0.0)
        ends = []
        for other in (b, c):
            p, q = corners[alone, a], corners[alone, other]
            share = height[alone, a] / (height[alone, a] - height[alone, other])
            ends.append(p + share[:, None] * (q - p))
        lines.append(np.stack(ends, axis=1))
    return np.concatenate(lines)
