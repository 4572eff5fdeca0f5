"""The aims of the surface on shipped parts with thin walls, handles and teeth; and the report."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory, load_part
from gpis_grasp_planner.surface import accuracy
from gpis_grasp_planner.surface.settings import SurfaceSettings


@pytest.mark.parametrize("mesh_id", ["mug", "flask", "spur_gear", "housing", "bishop"])
def test_shipped_parts_reach_the_aims(mesh_id):
    mesh = load_part(default_catalogue_directory() / f"{mesh_id}.stl").mesh
    found = accuracy.measure(mesh, SurfaceSettings(), seed=5, n_points=2000)
    assert found.converged > 0.999
    assert found.distances.mean() < 0.0005 * mesh.diagonal  # the aim is 0.003
    assert np.percentile(found.distances, 99) < 0.005 * mesh.diagonal
    assert np.median(found.angles_deg[found.smooth]) < 2.5  # the aim is 5
    assert np.mean(found.values_at_mesh < 0.0002) > 0.9


def test_a_displaced_surface_would_be_seen(shapes, monkeypatch):
    mesh, grown = shapes.box_mesh((0.1, 0.1, 0.1)), shapes.box_mesh((0.102, 0.102, 0.102))
    fit = accuracy.fit_part
    monkeypatch.setattr(accuracy, "fit_part", lambda _, *rest: fit(grown, *rest))
    found = accuracy.measure(mesh, SurfaceSettings(n_samples=2000), n_points=500)
    assert np.median(found.distances) == pytest.approx(0.001, rel=0.02)
    assert np.mean(found.values_at_mesh > 0.0005) > 0.95


def test_command_prints_a_table(tmp_path, capsys):
    for name in ("sphere.stl", "sphere.yaml"):
        shipped = default_catalogue_directory() / name
        (tmp_path / name).write_bytes(shipped.read_bytes())
    assert accuracy.main([str(tmp_path), "--samples", "500"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert lines[2].startswith("| sphere |")
    assert len({line.replace("\\|", "").count("|") for line in lines}) == 1


def test_command_says_what_is_wrong(tmp_path, capsys):
    (tmp_path / "empty.stl").write_bytes(b"")
    assert accuracy.main([str(tmp_path)]) == 1
    assert "empty" in capsys.readouterr().err
    assert accuracy.main([str(tmp_path / "nowhere")]) == 1
    assert accuracy.main([str(tmp_path), "--kernel", "linear"]) == 1
    assert "choose one of" in capsys.readouterr().err
