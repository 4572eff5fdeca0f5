"""A corpus of legal oddities: each is planned on as the solid that it is, or refused truly.

What is checked is the judged shape: closed, the solid's volume and bounds. The files are made
by the tests, small, in the forms that programs are known to write.
"""

from __future__ import annotations

import mesh_corpus
import mesh_dialects as d
import numpy as np
import pytest
import scene_corpus
from mesh_corpus import Read, Refused
from mesh_dialects import BOX

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.geometry.mesh_file import load_mesh

KINDS = {
    "obj": mesh_corpus.OBJ,
    "off": mesh_corpus.OFF,
    "ply": mesh_corpus.PLY,
    "stl": mesh_corpus.STL,
    "glb": scene_corpus.GLB,
    "3mf": scene_corpus.THREEMF,
}
CORPUS = {
    f"{suffix} {name}": (suffix, case)
    for suffix, cases in KINDS.items()
    for name, case in cases.items()
}


def test_the_corpus_is_large() -> None:
    assert len(CORPUS) >= 150


@pytest.mark.parametrize("name", CORPUS)
def test_an_oddity_is_the_solid_that_it_is_or_refused_with_its_reason(name, mesh_path):
    suffix, case = CORPUS[name]
    path = mesh_path(case.data, f"part.{suffix}")
    if isinstance(case, Refused):
        with pytest.raises(MeshError) as caught:
            load_mesh(path, "mm")
        assert caught.value.code == case.code, caught.value.message
        for word in case.words:
            assert word in caught.value.message
        return
    mesh, report = load_mesh(path, case.unit)
    assert report.watertight
    assert report.volume == pytest.approx(1e-9 * case.solid.volume, rel=1e-5)
    expected = 1e-3 * np.stack([case.solid.vertices.min(axis=0), case.solid.vertices.max(axis=0)])
    np.testing.assert_allclose(mesh.bounds, expected, atol=1e-7)
    own = [n for n in report.notes if "separate bodies" not in n and "y points up" not in n]
    if not case.note:
        assert own == []
    assert any(case.note in n for n in report.notes) or not case.note, report.notes


@pytest.mark.parametrize("suffix", ["obj", "off", "ply", "stl", "glb", "3mf"])
def test_a_file_of_any_kind_is_no_crash_under_any_other_ending(suffix, mesh_path):
    """Every content of the corpus under a foreign ending: an error of the project, or the solid."""
    for name, (own, case) in CORPUS.items():
        if own == suffix or not isinstance(case, Read):
            continue
        try:
            _, report = load_mesh(mesh_path(case.data, f"part.{suffix}"), "mm")
        except MeshError:
            continue
        assert report.volume == pytest.approx(1e-9 * case.solid.volume, rel=1e-5), name


def test_primitives_are_counted_before_they_are_read(mesh_path):
    document, binary = d.glb_document(BOX)
    document["meshes"][0]["primitives"] *= 20
    with pytest.raises(MeshError, match="has 108 faces, the limit is 100") as caught:
        load_mesh(
            mesh_path(d.glb(document, binary), "part.glb"), "m", CatalogueSettings(max_faces=100)
        )
    assert caught.value.code == ErrorCode.MESH_TOO_LARGE


def test_vertices_of_instances_are_counted_before_they_are_made(mesh_path):
    vertices = "".join(f'<vertex x="{i}" y="0" z="0"/>' for i in range(2000))
    triangle = '<triangles><triangle v1="0" v2="1" v3="2"/></triangles>'
    copies = '<component objectid="1"/>' * 50
    resources = (
        f'<object id="1"><mesh><vertices>{vertices}</vertices>{triangle}</mesh></object>'
        f'<object id="2"><components>{copies}</components></object>'
    )
    data = d.threemf(d.model_xml(resources, '<item objectid="2"/>'))
    with pytest.raises(MeshError, match="vertices"):
        load_mesh(mesh_path(data, "part.3mf"), "mm", CatalogueSettings(max_faces=100))


def test_limits_hold_for_instances(mesh_path):
    nodes = [{"mesh": 0, "translation": [0.001 * i, 0, 0]} for i in range(20)]
    path = mesh_path(d.glb(*d.glb_document(BOX, nodes=nodes)), "part.glb")
    with pytest.raises(MeshError, match="the limit is 100") as caught:
        load_mesh(path, "m", CatalogueSettings(max_faces=100))
    assert caught.value.code == ErrorCode.MESH_TOO_LARGE
