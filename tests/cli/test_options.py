from __future__ import annotations

from pathlib import Path

import mesh_dialects as d
import pytest
import step_dialects

from gpis_grasp_planner.cli.options import (
    catalogue_of,
    find_part,
    friction_of,
    read_groups,
    read_settings,
    setting_classes,
)
from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, RequestError
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.plan.document import MeshSource
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.settings import describe


def test_no_options_are_the_defaults() -> None:
    settings, catalogue = read_settings(None, [])
    assert settings == PlannerSettings()
    assert catalogue.default_unit == "m"


def test_every_setting_can_be_set_by_text() -> None:
    """Its default as text gives its default, whatever the type."""
    for group, settings in setting_classes().items():
        for info in describe(settings):
            text = ",".join(info.default) if info.type is tuple else str(info.default)
            values = read_groups(None, [f"{group}.{info.name}={text}"])
            assert values == {group: {info.name: info.default}}
            assert type(values[group][info.name]) is type(info.default)


def test_set_goes_over_the_file_and_both_over_the_defaults(tmp_path: Path) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text("hpp: {batch: 7, xi: 2e-2}\ncatalogue: {default_unit: mm}\n")
    settings, catalogue = read_settings(file, ["hpp.batch=3", "scene.cone_edges = 12"])
    assert (settings.hpp.batch, settings.hpp.xi, settings.scene.cone_edges) == (3, 0.02, 12)
    assert catalogue.default_unit == "mm"
    assert settings.adaption == PlannerSettings().adaption


@pytest.mark.parametrize(
    ("assignment", "word"),
    [
        ("batch=3", "group.name=value"),
        ("hpp.batch", "group.name=value"),
        ("hop.batch=3", "hpp"),
        ("hpp.bunch=3", r"'hpp.bunch'. Nearest: hpp.batch"),
        ("scene.batch=3", "hpp.batch"),
        ("hpq.batch=3", "nearest is hpp"),
        ("hpp.batch=many", "takes a whole number"),
        ("hpp.batch=1.5", "a whole number"),
        ("hpp.batch=0", r"\[1, 64\]"),
        ("hpp.xi=nan", "finite"),
        ("verification.mass_kg=0", "mass_kg"),
        ("catalogue.default_unit=foot", "mm"),
    ],
)
def test_a_bad_assignment_says_what_is_right(assignment: str, word: str) -> None:
    with pytest.raises(RequestError, match=word) as caught:
        read_settings(None, [assignment])
    assert caught.value.code == ErrorCode.INVALID_SETTING


@pytest.mark.parametrize("text", ["[1]", "hpp: 3", "{", "hpp: {batch: [1]}"])
def test_a_bad_settings_file_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text(text)
    with pytest.raises(RequestError):
        read_settings(file, [])


def test_an_empty_settings_file_changes_nothing(tmp_path: Path) -> None:
    file = tmp_path / "settings.yaml"
    file.write_text("# nothing\n")
    assert read_settings(file, [])[0] == PlannerSettings()


def test_friction_of_all_links_and_of_the_palm() -> None:
    own = Friction(0.3, 0.2)
    assert friction_of(None, None, own) is None
    assert friction_of(0.5, None, own) == Friction(0.5, 0.5)
    assert friction_of(0.5, 0.1, own) == Friction(0.5, 0.1)
    assert friction_of(None, 0.1, own) == Friction(0.3, 0.1)
    assert friction_of(None, 0.1, None) == Friction(0.6, 0.1)


def test_an_id_and_a_path_to_the_same_mesh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    catalogue = catalogue_of(None)
    by_id, nowhere = find_part("mug", None, catalogue)
    assert nowhere is None
    file = tmp_path / "cup.stl"
    file.write_bytes((default_catalogue_directory() / "mug.stl").read_bytes())
    by_path, source = find_part(str(file), "mm", catalogue)
    assert source == MeshSource(str(file), "mm")
    assert by_path.mesh_id == "cup"
    assert by_path.mesh.content_hash == by_id.mesh.content_hash
    monkeypatch.chdir(tmp_path)
    here, source = find_part("cup.stl", "mm", catalogue)
    assert source == MeshSource("cup.stl", "mm")
    assert here.mesh.content_hash == by_id.mesh.content_hash


@pytest.mark.parametrize(
    ("mesh", "unit", "code"),
    [
        ("mugg", None, ErrorCode.UNKNOWN_MESH),
        ("nothere.step", None, ErrorCode.MESH_UNREADABLE),
        ("NOTHERE.STL", "mm", ErrorCode.MESH_UNREADABLE),
        ("./nothing.stl", None, ErrorCode.MESH_UNREADABLE),
        ("mug", "mm", ErrorCode.INVALID_SETTING),
        ("../mug", None, ErrorCode.MESH_FORMAT_NOT_SUPPORTED),
    ],
)
def test_a_mesh_that_is_not_there(mesh: str, unit: str | None, code: ErrorCode) -> None:
    with pytest.raises(GraspPlannerError) as caught:
        find_part(mesh, unit, catalogue_of(None))
    assert caught.value.code == code


def test_a_file_that_is_missing_is_a_file_and_the_nearest_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "housing.step").write_bytes(b"")
    monkeypatch.chdir(tmp_path)
    for mesh, word in [
        ("housng.step", r"No such file: housng.step. Did you mean housing.step\?"),
        (str(tmp_path / "housng.step"), r"Did you mean .*/housing.step\?"),
        ("./parts/a.stl", "no directory parts"),
        ("teapot.ply", "Check the path"),
    ]:
        with pytest.raises(GraspPlannerError, match=word):
            find_part(mesh, None, catalogue_of(None))


def test_one_body_of_a_file_is_found_and_remembered(tmp_path: Path) -> None:
    path = tmp_path / "whole.step"
    parts = [("bolt", d.box((20, 20, 20)), (0, 0, 0)), ("plate", d.box((80, 60, 5)), (0, 0, 30))]
    path.write_bytes(step_dialects.assembly(parts))
    part, source = find_part(str(path), None, catalogue_of(None), "plate")
    assert part.mesh.extent == pytest.approx((0.08, 0.06, 0.005))
    assert source is not None
    assert source.body == "plate"
    with pytest.raises(RequestError, match="--body plate is for mesh files"):
        find_part("mug", None, catalogue_of(None), "plate")
