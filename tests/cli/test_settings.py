from __future__ import annotations

import json

import pytest

from gpis_grasp_planner.cli.options import as_text, read_groups, setting_classes
from gpis_grasp_planner.settings import SettingInfo, describe


def infos(common: bool = False) -> dict[str, SettingInfo]:
    return {
        f"{group}.{info.name}": info
        for group, settings in setting_classes().items()
        for info in describe(settings)
        if info.common or not common
    }


def test_every_setting_is_there_with_default_bounds_and_meaning(gpis_grasp) -> None:
    answer = gpis_grasp("settings", "--advanced", "--markdown")
    assert answer.code == 0
    lines = answer.out.splitlines()
    for group in setting_classes():
        assert f"## {group}" in lines
    for name, info in infos().items():
        [line] = [row for row in lines if row.startswith(f"| `{name}` |")]
        assert f"| `{info.default}` | {info.range_text()} | {info.description} |" in line
    assert len(infos()) > 20


def test_the_list_fits_80_columns_and_its_lines_can_be_typed(gpis_grasp) -> None:
    answer = gpis_grasp("settings", "--advanced")
    lines = answer.out.splitlines()
    assert max(map(len, lines)) < 80
    for name, info in infos().items():
        [line] = [row for row in lines if row.startswith(f"  {name} = ")]
        assignment = line.strip().partition("  (")[0].replace(" = ", "=")
        group, _, own = name.partition(".")
        assert read_groups(None, [assignment]) == {group: {own: info.default}}
        assert " ".join(info.description.split()[:3]) in answer.out


def test_without_advanced_those_that_users_change(gpis_grasp) -> None:
    answer = gpis_grasp("settings")
    shown = {
        line.split()[0]
        for line in answer.out.splitlines()
        if line.startswith("  ") and " = " in line
    }
    assert shown == set(infos(common=True))
    assert 5 <= len(shown) <= 30
    assert f"{len(infos()) - len(shown)} more with --advanced." in answer.out


def test_one_group(gpis_grasp) -> None:
    lines = gpis_grasp("settings", "hpp", "--advanced").out.splitlines()
    assert lines[0].startswith("hpp: ")
    assert all(line.startswith("  ") for line in lines[1:] if line)
    answer = gpis_grasp("settings", "hhp")
    assert answer.code == 1
    assert "Nearest: hpp." in answer.err


def test_json(gpis_grasp) -> None:
    values = json.loads(gpis_grasp("settings", "--advanced", "--json").out)
    read = {f"{group}.{one['name']}": one for group, ones in values.items() for one in ones}
    assert set(read) == set(infos())
    for name, info in infos().items():
        default = list(info.default) if isinstance(info.default, tuple) else info.default
        assert read[name]["default"] == default
        assert (read[name]["low"], read[name]["high"]) == (info.low, info.high)


@pytest.mark.parametrize(
    ("value", "text"), [(True, "true"), (("a", "b"), "a,b"), (0.5, "0.5"), ("m", "m"), ((), "")]
)
def test_values_as_one_types_them(value: object, text: str) -> None:
    assert as_text(value) == text
