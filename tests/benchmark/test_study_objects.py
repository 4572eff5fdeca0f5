from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from gpis_grasp_benchmark.study_objects import SHIPPED, collect
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory


def test_the_shipped_parts() -> None:
    objects = collect([Path(SHIPPED)])
    assert list(objects.parts) == MeshCatalogue([default_catalogue_directory()]).ids()
    assert set(objects.set_of.values()) == {"shipped parts"}
    assert objects.refused == ()


def test_a_name_in_two_sets_stays_two_objects_and_bad_meshes_are_kept_by_name(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "My Parts"
    folder.mkdir()
    shutil.copy(default_catalogue_directory() / "mug.stl", folder / "mug.stl")
    (folder / "mug.yaml").write_text("unit: mm\n")
    (folder / "broken.stl").write_bytes(b"solid nothing\n")
    objects = collect([Path(SHIPPED), folder], ["mug", "my-parts-mug", "broken"])
    assert objects.set_of == {"mug": "shipped parts", "my-parts-mug": "My Parts"}
    [refusal] = objects.refused
    assert (refusal.object_id, refusal.object_set) == ("broken", "My Parts")
    assert "broken.stl" in refusal.message


def test_facts_are_for_the_original_objects_only() -> None:
    # The shipped mug has the name of one of the original simulator's, not its size.
    objects = collect([Path(SHIPPED)], ["mug"], {"mug": {"mass": 7.0}})
    assert objects.parts["mug"].mass != 7.0


def test_unknown_objects_and_empty_directories(tmp_path: Path) -> None:
    with pytest.raises(RequestError, match="Unknown objects teapot"):
        collect([Path(SHIPPED)], ["teapot"])
    with pytest.raises(RequestError, match="no mesh"):
        collect([tmp_path])
