from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from gpis_grasp_planner.view.plots import plot_convergence


def test_a_plot_has_a_line_per_planner(tmp_path: Path) -> None:
    times = np.linspace(0.0, 20.0, 50)
    curves = {
        "hpp": np.stack([np.minimum(times, 10.0) * 0.01, np.minimum(times, 8.0) * 0.01]),
        "random": np.zeros((2, 50)),
    }
    path = tmp_path / "mug.svg"
    plot_convergence(times, curves, path=path, title="mug of the plot")
    text = path.read_text()
    # Matplotlib's colours C0 and C1, one for each planner, the band included.
    assert "#1f77b4" in text
    assert "#ff7f0e" in text
    assert "#2ca02c" not in text
    plot_convergence(times, curves, path=tmp_path / "mug.png")
    with Image.open(tmp_path / "mug.png") as image:
        pixels = np.asarray(image.convert("RGB"))
    assert pixels.shape[:2] == (504, 840)
    assert pixels.std() > 10.0
