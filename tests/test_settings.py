"""Settings: every wrong value is refused with the value, the limit and the default."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, dataclass

import pytest

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.settings import SettingsGroup, describe, setting


@dataclass(frozen=True)
class Example(SettingsGroup):
    clearance_m: float = setting(0.12, low=0.0, high=1.0, description="A length.")
    count: int = setting(3, low=1, description="A number.")
    enabled: bool = setting(True, description="A switch.")
    kind: str = setting("a", choices=("a", "b"), description="A choice.")
    paths: tuple[str, ...] = setting(("x",), description="Some texts.")


def test_defaults_bounds_and_types_are_described_in_order():
    infos = describe(Example)
    assert [i.name for i in infos] == ["clearance_m", "count", "enabled", "kind", "paths"]
    assert [i.type for i in infos] == [float, int, bool, str, tuple]
    assert [i.range_text() for i in infos] == ["[0, 1]", "[1, inf]", "any", "a, b", "any"]
    assert Example().as_dict() == {i.name: i.default for i in infos} | {"paths": ["x"]}


@pytest.mark.parametrize(
    ("name", "value", "kept"),
    [
        ("clearance_m", 0.0, 0.0),
        ("clearance_m", 1.0, 1.0),
        ("clearance_m", 1, 1.0),
        ("count", 1, 1),
        ("enabled", False, False),
        ("kind", "b", "b"),
        ("paths", ["p", "q"], ("p", "q")),
        ("paths", [], ()),
    ],
)
def test_right_values_are_kept_in_the_declared_type(name, value, kept):
    found = getattr(Example(**{name: value}), name)
    assert found == kept
    assert type(found) is type(kept)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("clearance_m", -1e-9),
        ("clearance_m", 1.0000001),
        ("clearance_m", float("nan")),
        ("clearance_m", float("inf")),
        ("clearance_m", 10**400),
        ("clearance_m", "0.1"),
        ("clearance_m", True),
        ("clearance_m", None),
        ("count", 0),
        ("count", 2.0),
        ("count", True),
        ("enabled", 1),
        ("enabled", "true"),
        ("kind", "c"),
        ("kind", ""),
        ("paths", "x"),
        ("paths", [1, 2]),
        ("paths", ("x", None)),
    ],
)
def test_wrong_values_are_refused_and_named(name, value):
    with pytest.raises(RequestError, match=f"'{name}'") as caught:
        Example(**{name: value})
    assert caught.value.code is ErrorCode.INVALID_SETTING


def test_mapping_with_unknown_names_lists_the_known_ones():
    assert Example.from_mapping({"count": 5}).count == 5
    with pytest.raises(RequestError, match=r"Unknown setting cuont; known are clearance_m, count"):
        Example.from_mapping({"cuont": 5})


def test_groups_are_frozen_and_equal_by_value():
    with pytest.raises(FrozenInstanceError):
        Example().count = 4
    assert Example(count=3) == Example()
    assert Example.from_mapping(Example(count=9).as_dict()) == Example(count=9)


def test_field_without_setting_is_a_mistake_of_the_programmer():
    @dataclass(frozen=True)
    class Bad(SettingsGroup):
        x: float = 1.0

    with pytest.raises(TypeError, match="setting"):
        describe(Bad)
