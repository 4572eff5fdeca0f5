"""The shipped parts: sound, graspable, as drawn, and what the script makes of them today."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gpis_grasp_benchmark.parts import generate, solids
from gpis_grasp_benchmark.parts.flips import flip_flat_edges
from gpis_grasp_benchmark.parts.gearbox import involute_outline
from gpis_grasp_benchmark.parts.generate import RECIPES
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.mass_properties import signed_volume
from gpis_grasp_planner.geometry.materials import MATERIALS
from gpis_grasp_planner.geometry.mesh_file import load_mesh
from gpis_grasp_planner.geometry.topology import find_edges

DIRECTORY = default_catalogue_directory()
RECIPE_OF = {r.name: r for r in RECIPES}


@pytest.fixture(scope="module")
def catalogue() -> MeshCatalogue:
    return MeshCatalogue([DIRECTORY])


def test_what_ships_is_what_the_recipes_make(catalogue):
    assert catalogue.ids() == sorted(RECIPE_OF)
    named = {"mug", "flask", "phone", "sphere", "bishop", "spur_gear", "stepped_shaft", "flange",
             "housing", "planet_carrier"}  # fmt: skip
    assert named < set(RECIPE_OF)


@pytest.mark.parametrize("name", RECIPE_OF)
def test_a_part_is_sound_and_of_ordinary_size(name, catalogue):
    part = catalogue.load(name)
    assert part.notes == ()  # nothing to repair, nothing to assume
    assert part.watertight
    edges = find_edges(part.mesh.faces)
    assert edges.closed
    assert edges.non_manifold == 0
    assert 2_500 <= len(part.mesh.faces) <= 12_000
    assert 0.03 <= part.mesh.extent.max() <= 0.21
    assert part.mesh.extent.min() >= 0.03
    assert 0.01 < part.mass < 2.0
    assert part.friction == MATERIALS[RECIPE_OF[name].material].friction
    assert np.abs(part.mesh.bounds.mean(axis=0)).max() < 0.02  # the origin lies in the middle
    assert (DIRECTORY / f"{name}.stl").stat().st_size < 300_000


@pytest.mark.parametrize("name", RECIPE_OF)
def test_the_script_makes_the_kept_mesh(name):
    """Equal surfaces to a micrometre, whatever the machine's sine rounds to."""
    recipe = RECIPE_OF[name]
    kept, _ = load_mesh(DIRECTORY / f"{name}.stl", "mm")
    made = 1e-3 * generate.make(recipe).astype(float)
    assert signed_volume(made) == pytest.approx(signed_volume(kept.triangles), rel=1e-6)
    corners = made.reshape(-1, 3)
    assert cKDTree(kept.vertices).query(corners)[0].max() < 1e-6
    assert cKDTree(corners).query(kept.vertices)[0].max() < 1e-6
    text = (DIRECTORY / f"{name}.yaml").read_text(encoding="utf-8")
    assert text == generate.sidecar_text(recipe)


def test_the_script_writes_what_the_catalogue_reads(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(generate, "RECIPES", (RECIPE_OF["sphere"],))
    generate.main([str(tmp_path)])
    assert "sphere" in capsys.readouterr().out
    assert (tmp_path / "sphere.stl").read_bytes()[:80].startswith(generate.STL_HEADER)
    assert MeshCatalogue([tmp_path]).load("sphere").notes == ()
    with pytest.raises(RequestError):
        MeshCatalogue([tmp_path]).load("mug")


def test_the_sphere_against_its_closed_form(catalogue):
    part = catalogue.load("sphere")
    radii = np.linalg.norm(part.mesh.vertices, axis=1)
    np.testing.assert_allclose(radii, 0.035, rtol=1e-6)
    assert part.volume == pytest.approx(4 / 3 * np.pi * 0.035**3, rel=5e-3)
    assert part.volume < 4 / 3 * np.pi * 0.035**3
    np.testing.assert_allclose(part.center_of_mass, 0.0, atol=1e-8)


def test_the_flange_against_its_closed_form(catalogue):
    """Disc, cone and bore less six bolt holes; fillets are worth less than 2 %."""
    part = catalogue.load("flange")
    disc = np.pi * (0.058**2 - 0.016**2) * 0.013
    cone = np.pi * 0.027 / 3 * (0.030**2 + 0.030 * 0.027 + 0.027**2) - np.pi * 0.016**2 * 0.027
    holes = 6 * np.pi * 0.005**2 * 0.013
    assert part.volume == pytest.approx(disc + cone - holes, rel=0.02)
    np.testing.assert_allclose(part.center_of_mass[:2], 0.0, atol=1e-5)


def test_turned_parts_have_their_centre_on_the_axis(catalogue):
    for name in ("flask", "flange", "planet_carrier", "bearing_cover"):
        np.testing.assert_allclose(catalogue.load(name).center_of_mass[:2], 0.0, atol=5e-5)


def test_the_mug_is_hollow_and_has_a_handle(catalogue):
    mug = catalogue.load("mug")
    body = np.pi * 0.042**2 * 0.095
    assert mug.volume < 0.4 * body
    assert mug.mesh.bounds[1, 0] > 0.042 + 0.02  # the handle, on the side of x
    genus = 1 - (len(mug.mesh.vertices) - len(find_edges(mug.mesh.faces).uses)
                 + len(mug.mesh.faces)) // 2  # fmt: skip
    assert genus == 1


def test_the_gear_s_flanks_are_involutes():
    """Unwound from the base circle, every flank point is as far away as the arc is long."""
    module, teeth = 4.0, 22
    outline = involute_outline(module, teeth, flank_points=9)
    base = 0.5 * module * teeth * np.cos(np.deg2rad(20.0))
    radii = np.linalg.norm(outline, axis=1)
    assert radii.max() == pytest.approx(0.5 * module * (teeth + 2))
    assert radii.min() == pytest.approx(0.5 * module * (teeth - 2.5))
    lower_flank = outline[:10]
    r, angle = np.linalg.norm(lower_flank, axis=1), np.arctan2(lower_flank[:, 1], lower_flank[:, 0])
    tangent = np.sqrt(np.maximum(r[1:] ** 2 - base**2, 0.0))
    roll = angle[1:] + np.arctan2(tangent, base)  # where the taut string leaves the base circle
    unwound = np.diff(roll) * base
    np.testing.assert_allclose(np.diff(tangent), unwound, atol=1e-9)
    # At the pitch circle tooth and gap are equally wide.
    at_pitch = np.interp(0.5 * module * teeth, r, angle)
    assert at_pitch == pytest.approx(-np.pi / (2 * teeth), abs=2e-3)


def test_a_fillet_that_does_not_fit_is_an_error():
    with pytest.raises(ValueError, match="does not fit corner 0"):
        solids.rounded([(0, 0, 5), (4, 0), (0, 4)])


def test_fillets_touch_both_sides():
    square = solids.rounded([(0, 0, 1), (4, 0, 1), (4, 4, 1), (0, 4, 1)])
    assert square.min() == pytest.approx(0.0)
    centers = np.clip(square, 1.0, 3.0)
    np.testing.assert_allclose(np.linalg.norm(square - centers, axis=1), 1.0)


def test_a_block_has_its_size():
    body = solids.block((10, 20, 30), (1, 2, 3))
    assert body.volume() == pytest.approx(6000.0)
    np.testing.assert_allclose(body.bounding_box(), (-4, -8, -12, 6, 12, 18))


def test_flips_keep_the_surface_and_remove_needles():
    plate = solids.extruded(solids.rounded([(0, 0), (60, 0), (60, 40), (0, 40)]), 0, 5)
    for x, y in solids.ring_of(5, 12.0):
        plate -= solids.cylinder(2.0, -1, 6, 24, 30 + x, 20 + y)
    mesh = plate.refine_to_length(6.0).to_mesh64()
    vertices, before = (
        np.array(mesh.vert_properties[:, :3]),
        np.array(mesh.tri_verts, dtype=np.int64),
    )
    after = flip_flat_edges(vertices, before)
    assert find_edges(after.astype(np.int32)).closed
    assert signed_volume(vertices[after]) == pytest.approx(
        signed_volume(vertices[before]), rel=1e-12
    )

    def smallest_angles(faces):
        t = vertices[faces]
        u, v = np.roll(t, -1, axis=1) - t, np.roll(t, 1, axis=1) - t
        cosine = np.sum(u * v, axis=2) / np.linalg.norm(u, axis=2) / np.linalg.norm(v, axis=2)
        return np.arccos(np.clip(cosine, -1, 1)).min(axis=1)

    assert np.median(smallest_angles(after)) > 1.2 * np.median(smallest_angles(before))
    assert smallest_angles(after).min() >= smallest_angles(before).min() - 1e-9
