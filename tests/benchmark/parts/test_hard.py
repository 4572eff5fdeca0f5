"""The hard parts: closed, of the size that their names say, and refined without cracks."""

from __future__ import annotations

from collections import Counter

import manifold3d
import numpy as np
import pytest

from gpis_grasp_benchmark.parts.generate import make, write_all
from gpis_grasp_benchmark.parts.hard import EDGE_MM, class_of, recipes
from gpis_grasp_benchmark.parts.long_edges import halved
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue
from gpis_grasp_planner.geometry.mass_properties import signed_volume

RECIPES = recipes()
SOME = [r for r in RECIPES if r.name in {
    "rod_6x80", "key_5x80x28", "plate_80x60x2", "bracket_40x40x30x2", "angle_25x3x60",
    "ring_30x16x12", "disc_40x4", "block_10x10x10", "pin_4x20", "screwdriver_18x60x3x50",
    "cutlery_170x16x2", "spoon_140x30x1p6", "panel_90x60x3", "channel_20x2x100",
    "shaft_8x14x10x30x40x30",
}]  # fmt: skip


def test_there_are_enough_of_each_class() -> None:
    names = [r.name for r in RECIPES]
    assert len(names) == len(set(names)) >= 60
    classes = Counter(map(class_of, names))
    assert len(classes) == 15
    assert min(classes.values()) >= 3
    assert len(SOME) == len(classes)


def test_written_parts_are_sound(tmp_path) -> None:
    """As the planner reads them: closed, nothing repaired, of one piece's volume and size."""
    write_all(tmp_path, SOME)
    catalogue = MeshCatalogue([tmp_path])
    assert catalogue.ids() == sorted(r.name for r in SOME)
    for recipe in SOME:
        part = catalogue.load(recipe.name)
        assert part.watertight, recipe.name
        assert not [note for note in part.notes if "zero" in note.lower()], part.notes
        longest = np.linalg.norm(
            part.mesh.triangles - np.roll(part.mesh.triangles, 1, axis=1), axis=2
        ).max()
        assert longest <= 1e-3 * EDGE_MM + 1e-7, recipe.name


@pytest.mark.parametrize(
    ("name", "extent_mm"),
    [
        ("rod_6x80", (80, 6, 6)),
        ("plate_80x60x2", (80, 60, 2)),
        ("ring_30x16x12", (30, 30, 12)),
        ("disc_40x4", (40, 40, 4)),
        ("block_10x10x10", (10, 10, 10)),
        ("pin_4x20", (20, 4, 4)),
        ("channel_20x2x100", (20, 20, 100)),
    ],
)
def test_a_part_has_the_size_of_its_name(name, extent_mm) -> None:
    [recipe] = [r for r in SOME if r.name == name]
    corners = make(recipe).reshape(-1, 3)
    np.testing.assert_allclose(np.ptp(corners, axis=0), extent_mm, atol=0.05)


def test_halving_leaves_the_surface_as_it_is() -> None:
    body = manifold3d.Manifold.cube((100, 7, 3))
    vertices, faces = halved(body, 5.0)
    triangles = vertices[faces]
    assert signed_volume(triangles) == pytest.approx(2100.0)
    assert np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max() <= 5.0
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert set(counts) == {2}
