"""The policy per defect: refused, repaired with a note, or noted."""

from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.defects import Judged, judge
from gpis_grasp_planner.geometry.topology import find_edges


def judged(vertices, faces, **settings) -> Judged:
    return judge(
        np.asarray(vertices, dtype=float),
        np.asarray(faces, dtype=np.int64),
        name="part.stl",
        unit="m",
        settings=CatalogueSettings(**settings),
    )


def refused(vertices, faces) -> MeshError:
    with pytest.raises(MeshError) as caught:
        judged(vertices, faces)
    assert caught.value.message.startswith("part.stl")
    return caught.value


def two_boxes(write, center, size=(0.05, 0.05, 0.05), inverted=False):
    """A box of 50 mm at the origin and another one."""
    v_1, f_1 = write.box_arrays((0.05, 0.05, 0.05))
    v_2, f_2 = write.box_arrays(size, center)
    return np.vstack([v_1, v_2]), np.vstack([f_1, (f_2[:, ::-1] if inverted else f_2) + 8])


def test_a_sound_box_passes_without_notes(write):
    found = judged(*write.box_arrays())
    assert found.notes == ()
    assert found.watertight
    assert found.bodies == 1
    assert found.volume == pytest.approx(np.prod(write.box_size))


def test_an_inverted_box_is_turned(write):
    vertices, faces = write.box_arrays()
    found = judged(vertices, faces[:, ::-1])
    assert found.notes == ("The faces looked inwards and were turned (inverted mesh).",)
    assert found.volume == pytest.approx(np.prod(write.box_size))
    away = found.mesh.triangles.mean(axis=1)
    assert (np.einsum("ij,ij->i", away, found.mesh.face_normals_outward) > 0).all()


def test_inconsistent_winding_is_mended(write, rng):
    vertices, faces = write.box_arrays()
    for k in range(1, 12):
        turned = faces.copy()
        chosen = rng.permutation(12)[:k]
        turned[chosen] = turned[chosen][:, ::-1]
        found = judged(vertices, turned)
        assert found.watertight
        assert found.volume == pytest.approx(np.prod(write.box_size))
        assert any("turned" in n for n in found.notes)


def test_an_open_box_takes_its_hull(write):
    vertices, faces = write.box_arrays(center=(0.01, 0, 0))
    found = judged(vertices, faces[2:])  # one side, two triangles, is missing
    assert not found.watertight
    assert found.volume == pytest.approx(np.prod(write.box_size))
    np.testing.assert_allclose(found.center_of_volume, (0.01, 0, 0), atol=1e-12)
    assert found.notes == (
        "The surface is open at 4 edges; volume and centre of mass are those of its convex hull.",
    )


def test_an_open_inverted_box_is_turned(write):
    vertices, faces = write.box_arrays()
    found = judged(vertices, faces[2:, ::-1])
    away = found.mesh.triangles.mean(axis=1)
    assert (np.einsum("ij,ij->i", away, found.mesh.face_normals_outward) > 0).all()
    assert "inverted" in found.notes[0]


def test_duplicate_faces_are_dropped(write):
    vertices, faces = write.box_arrays()
    found = judged(vertices, np.vstack([faces, np.roll(faces[3:5], 1, axis=1)]))
    assert found.notes == ("2 duplicate faces were dropped.",)
    assert found.watertight
    assert len(found.mesh.faces) == 12


def test_equal_and_unused_vertices_are_merged_silently(write, rng):
    vertices, faces = write.box_arrays()
    soup = vertices[faces].reshape(-1, 3)
    found = judged(
        np.vstack([soup, rng.uniform(-0.01, 0.01, (5, 3))]), np.arange(36).reshape(12, 3)
    )
    assert found.mesh.vertices.shape == (8, 3)
    assert found.notes == ()


def test_nearly_equal_vertices_are_joined_where_that_closes_the_surface(write, rng):
    vertices, faces = write.box_arrays()
    soup = vertices[faces].reshape(-1, 3) + rng.uniform(-1e-9, 1e-9, (36, 3))
    found = judged(soup, np.arange(36).reshape(12, 3))
    assert found.watertight
    assert found.mesh.vertices.shape == (8, 3)
    assert "joined to close" in found.notes[0]


def test_two_separate_bodies_are_one_part(write):
    found = judged(*two_boxes(write, (0.1, 0, 0)))
    assert found.bodies == 2
    assert found.notes == ("2 separate bodies are planned on as one rigid part.",)
    assert found.volume == pytest.approx(2 * 0.05**3)
    np.testing.assert_allclose(found.center_of_volume, (0.05, 0, 0), atol=1e-12)


def test_one_inverted_body_of_two_is_turned(write):
    found = judged(*two_boxes(write, (0.1, 0, 0), inverted=True))
    assert found.volume == pytest.approx(2 * 0.05**3)
    assert found.notes[0] == "12 faces looked inwards and were turned."


def test_a_cavity_stays_a_cavity(write):
    found = judged(*two_boxes(write, (0.01, 0, 0), (0.02, 0.02, 0.02), inverted=True))
    assert found.watertight
    assert found.volume == pytest.approx(0.05**3 - 0.02**3)
    assert found.notes == ("2 separate bodies are planned on as one rigid part.",)


def test_overlapping_bodies_are_reported(write):
    found = judged(*two_boxes(write, (0.025, 0.01, 0.01)))
    assert found.watertight
    assert any("overlap" in n for n in found.notes)


def test_a_surface_through_itself_is_reported(write):
    vertices, faces = write.box_arrays((0.05, 0.05, 0.05))
    vertices = vertices.copy()
    top = vertices[:, 2] > 0
    vertices[top, 2] = -0.05  # the lid is pushed out through the bottom: partly inverted
    vertices[0, 2] = -0.06
    assert any("intersects itself" in n for n in judged(vertices, faces).notes)


def test_non_manifold_edges_are_reported(write):
    vertices, faces = two_boxes(write, (0.05, 0.05, 0.0))  # two boxes touch along an edge
    found = judged(vertices, faces)
    assert found.watertight
    assert found.volume == pytest.approx(2 * 0.05**3)
    assert any("1 edges have more than two faces" in n for n in found.notes)


def test_a_moebius_strip_is_left_as_it_is():
    angle = np.linspace(0, 2 * np.pi, 5, endpoint=False)
    vertices = 0.05 * np.stack([np.cos(angle), np.sin(angle), 0.5 * np.sin(2 * angle)], axis=1)
    found = judged(vertices, [(i, (i + 1) % 5, (i + 2) % 5) for i in range(5)])
    assert "one-sided" in found.notes[0]
    assert not found.watertight


def test_a_flat_mesh_is_refused():
    vertices = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]
    error = refused(vertices, [[0, 1, 2], [0, 2, 3]])
    assert error.code == ErrorCode.MESH_DEGENERATE
    assert "flat" in error.message


def test_a_double_sheet_takes_its_hull(write):
    vertices, faces = write.box_arrays()
    sheet = faces[:6]  # three sides, once from each side
    found = judged(vertices, np.vstack([sheet, sheet[:, ::-1]]))
    assert not found.watertight
    assert "encloses no volume" in found.notes[-1]


def test_a_mesh_of_nothing_but_thin_faces_is_refused():
    vertices = [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]]
    error = refused(vertices, [[0, 1, 2]])
    assert error.code == ErrorCode.MESH_DEGENERATE
    assert "none of its 1 faces has an area" in error.message


def box_with_slivers(write, count):
    """A box with vertices on one edge that only one of its sides knows: caps close the rest."""
    vertices, faces = write.box_arrays()
    first = faces[0]  # its edge a-b is cut into count + 1 pieces, and each cut closed by a cap
    a, b, c = first
    cuts = [
        vertices[a] + (vertices[b] - vertices[a]) * k / (count + 1) for k in range(1, count + 1)
    ]
    on_edge = [a, *range(len(vertices), len(vertices) + count), b]
    fan = [(on_edge[k], on_edge[k + 1], c) for k in range(count + 1)]
    caps = [(on_edge[k + 1], on_edge[k], b) for k in range(count)]
    return np.vstack([vertices, cuts]), np.vstack([faces[1:], fan, caps])


@pytest.mark.parametrize("count", [1, 2, 7, 40])
def test_slivers_are_taken_out_of_a_closed_surface_and_it_stays_closed(write, count):
    vertices, faces = box_with_slivers(write, count)
    assert find_edges(faces).closed
    found = judged(vertices, faces)
    assert found.watertight
    assert found.volume == pytest.approx(np.prod(write.box_size), rel=1e-12)
    assert found.notes == (f"{count} faces without area were dropped.",)
    assert find_edges(found.mesh.faces).uses.max() == 2
    strict = CatalogueSettings(degenerate_faces="refuse")
    with pytest.raises(MeshError, match="has no area"):
        judge(vertices, faces, name="part.stl", unit="m", settings=strict)


@pytest.mark.parametrize("inverted", [False, True])
def test_many_loose_pieces_are_fine(write, inverted):
    """Engraved text and knurls: hundreds of bodies."""
    shifts = 0.001 * np.arange(301)[:, None, None] * np.ones(3)
    vertices, faces = write.box_arrays((0.0005, 0.0005, 0.0005))
    many = (vertices[None] + shifts).reshape(-1, 3)
    faces = (faces[None] + 8 * np.arange(301)[:, None, None]).reshape(-1, 3)
    found = judged(many, faces[:, ::-1] if inverted else faces)
    assert found.bodies == 301
    assert found.volume == pytest.approx(301 * 0.0005**3)
    assert found.notes[-1] == "301 separate bodies are planned on as one rigid part."


def test_empty_and_bad_indices():
    assert refused(np.zeros((0, 3)), np.zeros((0, 3))).code == ErrorCode.MESH_EMPTY
    error = refused(np.eye(3), [[0, 1, 2], [0, 1, 3]])
    assert error.code == ErrorCode.MESH_BAD_INDEX
    assert "face 2 " in error.message


def test_judging_twice_changes_nothing(write, rng):
    vertices, faces = write.box_arrays()
    turned = faces.copy()
    turned[::3] = turned[::3][:, ::-1]
    once = judged(vertices, turned)
    again = judged(once.mesh.vertices, once.mesh.faces)
    assert again.mesh.content_hash == once.mesh.content_hash
    assert again.notes == ()
    assert find_edges(again.mesh.faces).closed
