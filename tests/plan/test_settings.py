"""The planner's settings: groups, bounds, and the way to JSON and back."""

from __future__ import annotations

import json
from dataclasses import fields

import pytest

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.plan.settings import PlannerSettings, setting_groups
from gpis_grasp_planner.settings import describe

INFOS = [(group, info) for group, cls in setting_groups().items() for info in describe(cls)]
NUMBERS = [(g, i) for g, i in INFOS if i.type in (int, float)]


def name_of(case):
    return f"{case[0]}.{case[1].name}"


def test_groups_are_the_fields_in_their_order():
    assert list(setting_groups()) == [f.name for f in fields(PlannerSettings)]


@pytest.mark.parametrize("case", INFOS, ids=name_of)
def test_defaults_pass_their_own_check_and_say_what_they_are(case):
    _, info = case
    assert info.check(info.default) == info.default
    assert info.description.strip()
    assert info.description.endswith((".", "..."))


@pytest.mark.parametrize("case", NUMBERS, ids=name_of)
def test_bounds_are_kept_and_named(case):
    group, info = case
    for value in (info.low, info.high):
        settings = PlannerSettings.from_mapping({group: {info.name: info.type(value)}})
        assert getattr(getattr(settings, group), info.name) == value
    for value in (info.type(info.low - 1), info.type(info.high + 1)):
        with pytest.raises(RequestError) as error:
            PlannerSettings.from_mapping({group: {info.name: value}})
        assert error.value.code is ErrorCode.INVALID_SETTING
        assert f"'{info.name}' is {value!r}, outside {info.range_text()}" in str(error.value)
        assert f"The default is {info.default!r}" in str(error.value)


@pytest.mark.parametrize("case", NUMBERS, ids=name_of)
@pytest.mark.parametrize("value", ["1", None, True, float("nan"), float("inf")])
def test_other_types_and_numbers_without_value_are_refused(case, value):
    group, info = case
    with pytest.raises(RequestError, match=f"'{info.name}' is"):
        PlannerSettings.from_mapping({group: {info.name: value}})


def test_settings_come_back_from_json():
    changed = {"hpp": {"n_initial": 7, "xi": 0.5}, "scene": {"cone_edges": 6}}
    settings = PlannerSettings.from_mapping(changed)
    again = PlannerSettings.from_mapping(json.loads(json.dumps(settings.as_dict())))
    assert again == settings
    assert settings != PlannerSettings()
    assert settings.as_dict()["hpp"]["n_initial"] == 7
    assert settings.as_dict()["hpp"]["batch"] == PlannerSettings().hpp.batch


def test_unknown_groups_and_names_list_the_known():
    with pytest.raises(RequestError) as error:
        PlannerSettings.from_mapping({"hpq": {}, "adaption": {}})
    assert str(error.value) == (
        f"Unknown group of settings hpq; known are {', '.join(setting_groups())}."
    )
    with pytest.raises(RequestError, match=r"Unknown setting n_seeds; known are .*n_seed"):
        PlannerSettings.from_mapping({"adaption": {"n_seeds": 3}})
