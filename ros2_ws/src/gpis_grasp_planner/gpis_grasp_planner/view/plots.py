"""Plots of measurements, drawn without a display."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray


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
