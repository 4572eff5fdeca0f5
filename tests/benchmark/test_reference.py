from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_benchmark.reference import (
    beside,
    is_original,
    object_facts,
    published,
)
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory

OBJECTS = {"mug", "flask", "phone", "sphere", "bishop"}


def test_every_table_has_every_object() -> None:
    data = published()
    for table in ("paper_mean", "paper_best", "simulator"):
        for name, figures in data[table].items():
            assert set(figures) == OBJECTS, (table, name)
            assert set(data["beside"]) >= {name}
            assert {len(f) for f in figures.values()} == {4 if table == "simulator" else 2}
    for table in ("objects", "extent_mm", "limit_eight_contacts"):
        assert set(data[table]) == OBJECTS


def test_a_mean_of_twenty_is_never_above_its_best() -> None:
    data = published()
    for name in data["paper_mean"]:
        for which in OBJECTS:
            assert data["paper_mean"][name][which][0] <= data["paper_best"][name][which][0]
    for figures in data["simulator"].values():
        for mean, _, best, found in figures.values():
            assert mean <= best
            assert 0.0 <= found <= 20.0
            assert mean <= best * found / 20.0 + 1e-4


def test_printed_figures() -> None:
    data = published()
    assert data["paper_mean"]["ADMM-CP-Opt"]["mug"] == [0.06, 0.0161]
    assert data["paper_best"]["HPP-Opt"]["phone"] == [0.0208, 0.0198]
    assert data["simulator"]["simulator two-level"]["bishop"][:2] == [0.0193, 0.0083]
    ratio = sum(v[0] for v in data["paper_mean"]["HPP-Opt"].values()) / sum(
        v[0] for v in data["paper_mean"]["EigenGrasp"].values()
    )
    assert ratio == pytest.approx(39.1, abs=0.05)


def test_originals_are_known_by_name_and_size() -> None:
    assert is_original("mug", [0.1335, 0.1, 0.1047])
    assert not is_original("cup", [0.1335, 0.1, 0.1047])
    catalogue = MeshCatalogue([default_catalogue_directory()])
    for mesh_id in OBJECTS:
        part = catalogue.load(mesh_id)
        assert not is_original(mesh_id, part.mesh.extent), "a shipped part is no original"


def test_the_facts_give_mass_centre_and_friction() -> None:
    facts = object_facts()
    assert facts["bishop"]["friction"] == {"finger": 0.4, "palm": 0.4}
    np.testing.assert_allclose(facts["bishop"]["center_of_mass"], [-0.02132, -2e-5, -0.03024])
    assert facts["flask"] == {
        "mass": 0.3,
        "center_of_mass": [0.0, 0.0, 0.0],
        "friction": {"finger": 0.3, "palm": 0.2},
    }


def test_planners_have_their_place() -> None:
    assert beside("dual") == ["ADMM-CP-Opt"]
    assert beside("eigengrasp") == ["EigenGrasp", "simulator EigenGrasp"]
    assert beside("random") == []
