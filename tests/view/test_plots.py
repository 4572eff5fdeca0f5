from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gpis_grasp_planner.view.plots import _section, plot_convergence
from gpis_grasp_planner.view.shapes import cylinder


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


@pytest.mark.parametrize("across", [0, 1, 2])
def test_the_section_of_a_cylinder_is_its_outline(across: int) -> None:
    """Points on the mesh, in the plane; their lines add up to the known length."""
    T = np.eye(4)
    T[:3, 3] = 0.01, 0.02, 0.03
    mesh = cylinder(T, 0.02, 0.08)
    level = T[across, 3] + 0.001
    lines = _section(mesh, across, level)
    np.testing.assert_allclose(lines[:, :, across], level, atol=1e-12)
    length = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum()
    half = np.sqrt(0.02**2 - 0.001**2)
    known = 2.0 * np.pi * 0.02 if across == 2 else 2.0 * (0.08 + 2.0 * half)
    assert length == pytest.approx(known, rel=0.01)
