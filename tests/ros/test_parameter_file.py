"""The parameter file of the package is that of the declared settings."""

from __future__ import annotations

import re
from pathlib import Path

import yaml

from gpis_grasp_planner.ros.parameter_file import parameter_file
from gpis_grasp_planner.ros.parameter_groups import parameter_infos

FILE = (
    Path(__file__).resolve().parents[2] / "ros2_ws/src/gpis_grasp_planner/config/grasp_planner.yaml"
)


def values_of(text: str) -> dict[str, object]:
    values: dict[str, object] = yaml.safe_load(text)["/**"]["ros__parameters"]
    return values


def test_the_file_is_up_to_date() -> None:
    command = f"python -m gpis_grasp_planner.ros.parameter_file {FILE.name}"
    assert FILE.read_text(encoding="utf-8") == parameter_file(), f"run: {command}"


def test_its_values_are_defaults_in_the_declared_types() -> None:
    infos = parameter_infos()
    values = values_of(parameter_file())
    assert len(values) > 30
    for name, value in values.items():
        assert type(value) is (list if infos[name].type is tuple else infos[name].type), name
        assert infos[name].check(value) == infos[name].default


def test_with_its_comments_taken_off_it_has_every_parameter() -> None:
    everything = re.sub(r"^    # (?=[a-z_.0-9]+: )", "    ", parameter_file(), flags=re.M)
    values = values_of(everything)
    infos = parameter_infos()
    assert set(values) == set(infos)
    for name, value in values.items():
        assert infos[name].check(value) == infos[name].default, name
