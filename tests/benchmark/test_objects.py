from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpis_grasp_benchmark.objects import load_objects, read_facts
from gpis_grasp_planner.errors import GraspPlannerError, RequestError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction


@pytest.fixture(scope="module")
def catalogue() -> MeshCatalogue:
    return MeshCatalogue([default_catalogue_directory()])


def test_all_of_a_catalogue_or_those_named(catalogue: MeshCatalogue) -> None:
    assert list(load_objects(catalogue)) == catalogue.ids()
    assert list(load_objects(catalogue, ["mug", "bishop"])) == ["mug", "bishop"]


def test_facts_go_over_the_file(catalogue: MeshCatalogue) -> None:
    facts = {
        "mug": {
            "mass": 0.2,
            "center_of_mass": [0.01, 0.0, 0.0],
            "friction": {"finger": 0.9, "palm": 0.8},
        },
        "bishop": {"density": 500},
        "nobody": {"mass": 1},
    }
    parts = load_objects(catalogue, ["mug", "bishop", "sphere"], facts)
    assert parts["mug"].mass == 0.2
    assert parts["mug"].friction == Friction(0.9, 0.8)
    np.testing.assert_array_equal(parts["mug"].center_of_mass, [0.01, 0.0, 0.0])
    bishop = catalogue.load("bishop")
    assert parts["bishop"].mass == pytest.approx(500.0 * bishop.volume)
    assert parts["bishop"].friction == bishop.friction
    assert parts["sphere"].mass == catalogue.load("sphere").mass


@pytest.mark.parametrize(
    ("facts", "word"),
    [
        ({"unit": "mm"}, "unit"),
        ({"mass": -1}, "mass"),
        ({"friction": "high"}, "friction"),
        ({"mass": 1, "density": 2}, "both"),
    ],
)
def test_bad_facts_are_refused(catalogue: MeshCatalogue, facts: dict, word: str) -> None:
    with pytest.raises(GraspPlannerError, match=word):
        load_objects(catalogue, ["mug"], {"mug": facts})


def test_facts_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "facts.yaml"
    file.write_text("mug: {mass: 0.2}\n")
    assert read_facts(file) == {"mug": {"mass": 0.2}}
    for bad in ("mug", "mug: 3", "{"):
        file.write_text(bad)
        with pytest.raises(RequestError, match=r"facts\.yaml"):
            read_facts(file)


def test_an_empty_directory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="no mesh"):
        load_objects(MeshCatalogue([tmp_path]))
