"""Parameters on a real node: what is declared, refused at the start and later, and taken."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from rclpy.node import Node
from rclpy.parameter import Parameter
from real_node import real_node

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.ros.parameter_groups import parameter_infos
from gpis_grasp_planner.ros.parameters import IMPORTING, TYPES, NodeParameters
from gpis_grasp_planner.ros.settings import READ_ONLY

INFOS = parameter_infos()


@contextmanager
def declared(arguments: str = "") -> Iterator[tuple[Node, NodeParameters]]:
    with real_node(lambda context: Node("parameters", context=context), arguments) as node:
        yield node, NodeParameters(node)


@pytest.fixture(scope="module")
def fresh() -> Iterator[tuple[Node, NodeParameters]]:
    """A node as it starts without arguments; tests that use it change nothing that stays."""
    with declared() as made:
        yield made


def put(node: Node, **values: Any) -> list[Any]:
    """Set parameters, with ``__`` for the point; the results."""
    return node.set_parameters(
        [Parameter(name.replace("__", "."), value=value) for name, value in values.items()]
    )


def test_every_setting_is_a_parameter_with_its_default(fresh: Any) -> None:
    node, _ = fresh
    for name, info in INFOS.items():
        value = node.get_parameter(name).value
        assert (tuple(value) if info.type is tuple else value) == info.default, name


def test_descriptions_bounds_types_and_read_only_are_those_of_the_settings(fresh: Any) -> None:
    node, _ = fresh
    for name, info in INFOS.items():
        told = node.describe_parameter(name)
        assert told.description == info.description, name
        assert told.read_only == (name in READ_ONLY), name
        # An empty list cannot tell its type; see the module.
        assert told.dynamic_typing == (info.type is tuple), name
        if info.type is not tuple:
            assert told.type == TYPES[info.type], name
        ranges = [*told.floating_point_range, *told.integer_range]
        if info.type in (int, float) and None not in (info.low, info.high):
            assert [(r.from_value, r.to_value) for r in ranges] == [(info.low, info.high)], name
        else:
            assert ranges == [], name
        for choice in info.choices or ():
            assert str(choice) in told.additional_constraints, name


def test_values_given_at_the_start_are_taken() -> None:
    with declared("-p queue_size:=3 -p arm.model:=six_axis -p uncertainty.method:=none") as (_, p):
        assert p.node.queue_size == 3
        assert p.arm_model() == "six_axis"
        assert not p.uses_covariance()
        assert p.planning_values()["arm"]["model"] == "six_axis"


@pytest.mark.parametrize(
    ("argument", "says"),
    [
        ("queue_sise:=3", "There is no parameter 'queue_sise'. Near are queue_size"),
        ("entirely.wrong:=3", "docs/parameters.md lists all"),
        ("queue_size:=many", "'queue_size' was given 'many'; it takes a whole number in"),
        ("planning_grace_s:=2", "it takes a number with a decimal point, such as 2.0"),
        ("queue_size:=100000", "'queue_size' was given 100000; it takes a whole number in"),
        ("default_planner:=guess", "default_planner"),
        ("track:=1", "it takes true or false"),
    ],
)
def test_what_is_wrong_at_the_start_is_refused_with_what_it_takes(argument: str, says: str) -> None:
    with (
        real_node(lambda c: Node("wrong", context=c), f"-p {argument}") as node,
        pytest.raises(RequestError) as caught,
    ):
        NodeParameters(node)
    assert says in caught.value.message
    assert caught.value.code is ErrorCode.INVALID_SETTING


@pytest.mark.parametrize("name", ["use_sim_time", "start_type_description_service"])
def test_parameters_that_rclpy_knows_are_left_to_it(name: str) -> None:
    with declared(f"-p {name}:=true"):
        pass


def test_a_change_is_seen_at_once_and_only_there() -> None:
    with declared() as (node, parameters):
        before, values = parameters.node, parameters.planning_values()
        assert parameters.planning_values() is values
        assert all(r.successful for r in put(node, max_pose_age_s=7.5))
        assert parameters.node.max_pose_age_s == 7.5
        assert before.max_pose_age_s != 7.5
        assert parameters.planning_values() == values
        put(node, clearance__margin_m=0.004)
        assert parameters.planning_values()["clearance"]["margin_m"] == 0.004
        assert values["clearance"]["margin_m"] != 0.004  # who planned with it keeps what it had


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("max_pose_age_s", -1.0),
        ("max_pose_age_s", float("nan")),
        ("max_pose_age_s", 3),
        ("default_planner", "guess"),
        ("queue_size", 3),
        ("mesh_directories", ["/tmp"]),
    ],
)
def test_a_refused_change_has_a_reason_and_leaves_everything(
    fresh: Any, name: str, value: Any
) -> None:
    node, parameters = fresh
    before = parameters.node
    [result] = put(node, **{name: value})
    assert not result.successful
    assert result.reason
    assert parameters.node == before
    assert node.get_parameter(name).value == (
        list(getattr(before, name)) if isinstance(value, list) else getattr(before, name)
    )


def test_of_changes_in_one_piece_all_are_taken_or_none(fresh: Any) -> None:
    node, parameters = fresh
    before = parameters.node
    changes = [Parameter("max_pose_age_s", value=4.0), Parameter("default_planner", value="guess")]
    assert not node.set_parameters_atomically(changes).successful
    assert parameters.node == before


def test_a_single_text_is_a_list_of_one() -> None:
    with declared("-p mesh_directories:=/one") as (_, parameters):
        assert parameters.node.mesh_directories == ("/one",)


def test_a_list_of_other_things_is_refused() -> None:
    with (
        real_node(lambda c: Node("wrong", context=c), "-p mesh_directories:=[1,2]") as node,
        pytest.raises(RequestError, match="list of texts"),
    ):
        NodeParameters(node)


def test_a_node_starts_with_what_another_one_has(fresh: Any, tmp_path: Path) -> None:
    """As `ros2 param dump` writes it: empty lists have no type in a file."""
    node, _ = fresh
    values = {name: node.get_parameter(name).value for name in INFOS}
    assert [] in values.values()
    plain = {n: list(v) if isinstance(v, tuple) else v for n, v in values.items()}
    file = tmp_path / "dump.yaml"
    file.write_text(yaml.dump({"/**": {"ros__parameters": plain}}))
    with declared(f"--params-file {file}") as (again, parameters):
        assert {name: again.get_parameter(name).value for name in INFOS} == values
        assert parameters.node.mesh_directories == ()


def test_parameters_of_others_on_the_node_are_none_of_its_business(fresh: Any) -> None:
    node, parameters = fresh
    if not node.has_parameter("another"):
        node.declare_parameter("another", 1)
    before = parameters.node
    assert put(node, another=2)[0].successful
    assert parameters.node == before


def test_the_hand_is_read_only(fresh: Any) -> None:
    node, parameters = fresh
    assert parameters.hand_model == INFOS["hand.model"].default
    assert not put(node, hand__model="other")[0].successful


@pytest.mark.parametrize("name", sorted(IMPORTING))
def test_a_module_is_named_at_the_start_alone(name: str) -> None:
    """Whoever can set parameters must not make the planner import what it was not started with."""
    is_list = INFOS[name].type is tuple
    given, other = "json:MINE", "antigravity:MEASURE"
    with declared(f"-p {name}:=['{given}']" if is_list else f"-p {name}:={given}") as (node, _):
        wrap = (lambda value: [value]) if is_list else (lambda value: value)
        [refused] = node.set_parameters([Parameter(name, value=wrap(other))])
        assert not refused.successful
        assert other in refused.reason
        assert "entry point" in refused.reason
        for taken in (given, "min_weight", "min_weight"):
            assert node.set_parameters([Parameter(name, value=wrap(taken))])[0].successful
        [refused] = node.set_parameters([Parameter(name, value=wrap(given))])
        assert not refused.successful  # it is gone: it would be another one now
    assert "antigravity" not in sys.modules


def test_what_may_import_is_what_says_so() -> None:
    assert {name for name, info in INFOS.items() if "module:NAME" in info.description} <= IMPORTING
