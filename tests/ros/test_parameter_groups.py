"""The page of the parameters is that of the code."""

from __future__ import annotations

from pathlib import Path

from gpis_grasp_planner.ros.parameter_groups import (
    parameter_groups,
    parameter_infos,
    parameters_page,
)
from gpis_grasp_planner.settings import describe

PAGE = Path(__file__).resolve().parents[2] / "docs/parameters.md"


def test_the_page_is_up_to_date() -> None:
    command = "python -m gpis_grasp_planner.ros.parameter_groups docs/parameters.md"
    assert PAGE.read_text(encoding="utf-8") == parameters_page(), f"run: {command}"


def test_every_setting_is_a_parameter_with_a_description() -> None:
    infos = parameter_infos()
    assert len(infos) == sum(len(describe(kind)) for kind in parameter_groups().values())
    assert all(info.description.endswith(".") for info in infos.values())
