"""STEP: units, damage, readers that crash, assemblies, and what the text promises."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.formats import step
from gpis_grasp_planner.geometry.mesh_file import load_mesh


def refused(path, unit: str = "m", limits: CatalogueSettings | None = None) -> MeshError:
    with pytest.raises(MeshError) as caught:
        load_mesh(path, unit, limits)
    assert str(path.parent) not in caught.value.message, "a path leaks"
    return caught.value


@pytest.mark.parametrize(
    ("unit", "size"), [(".MILLI.", (60, 50, 40)), ("$", (0.06, 0.05, 0.04)), (".CENTI.", (6, 5, 4))]
)
def test_step_brings_its_own_unit(unit, size, write, mesh_path):
    mesh, report = load_mesh(mesh_path(write.step_box(size, unit), "box.step"), "mm")
    np.testing.assert_allclose(mesh.extent, write.box_size, rtol=1e-6)
    assert report.watertight
    assert report.volume == pytest.approx(np.prod(write.box_size), rel=1e-6)
    assert report.unit == "m"


@pytest.mark.parametrize("code", ["os.kill(os.getpid(), 11)", "sys.exit(3)", "pass"])
def test_a_step_reader_that_crashes_takes_nothing_with_it(code, write, mesh_path, monkeypatch):
    """OpenCASCADE does crash on damaged files; here its process is told to."""
    monkeypatch.setattr(step, "TESSELLATE", f"import os, sys\n{code}")
    error = refused(mesh_path(write.step_box((60, 50, 40)), "box.step"))
    assert error.code == ErrorCode.MESH_UNREADABLE
    assert "damaged" in error.message


def test_a_step_reader_that_hangs_is_ended(write, mesh_path, monkeypatch):
    monkeypatch.setattr(step, "TESSELLATE", "import time\ntime.sleep(600)")
    limits = CatalogueSettings(step_timeout_s=1.0)
    error = refused(mesh_path(write.step_box((60, 50, 40)), "box.step"), limits=limits)
    assert "within 1 s" in error.message


def test_damaged_step_files_are_refused_and_nothing_dies(write, mesh_path, rng):
    data = write.step_box((60, 50, 40))
    start = data.index(b"DATA;")
    for _ in range(4):
        damaged = bytearray(data)
        for position in rng.integers(start, len(data) - 60, 3):
            del damaged[position : position + int(rng.integers(1, 100))]
        try:
            _, report = load_mesh(mesh_path(bytes(damaged), "box.step"), "m")
        except MeshError:
            continue
        assert report.volume > 0
