"""ROS parameters from the settings: declared once there, checked the same way at every time."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from gpis_grasp_planner.arm.settings import ArmSettings
from gpis_grasp_planner.errors import GraspPlannerError, RequestError
from gpis_grasp_planner.hand.settings import HandSettings
from gpis_grasp_planner.registered import names_a_module
from gpis_grasp_planner.ros.parameter_groups import parameter_groups, parameter_infos
from gpis_grasp_planner.ros.settings import READ_ONLY, NodeSettings
from gpis_grasp_planner.ros.text import printable
from gpis_grasp_planner.settings import SettingInfo, SettingsGroup
from gpis_grasp_planner.surroundings.uncertainty_settings import UncertaintySettings

TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
    tuple: ParameterType.PARAMETER_STRING_ARRAY,
}
IN_WORDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number with a decimal point, such as 2.0",
    str: "a text",
    tuple: "a list of texts, such as \"['/one', '/two']\"",
}
# What may be ``module:NAME``.
IMPORTING = frozenset({"objective.name", "objective.report", "constraints.names"})
# Parameters that rclpy itself knows.
BUILT_IN = ("use_sim_time", "start_type_description_service", "qos_overrides.")


class NodeParameters:
    """The declared parameters of a node and the settings they hold at present.

    Raises
    ------
    RequestError
        If a value given at the start is refused, or belongs to no parameter.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._infos = parameter_infos()
        self._refuse_unknown()
        for name, info in self._infos.items():
            self._declare(name, info)
        self._take([])
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._take)

    @property
    def node(self) -> NodeSettings:
        """The node's own settings at this moment."""
        group = self._groups[""]
        assert isinstance(group, NodeSettings)
        return group

    def planning_values(self) -> dict[str, dict[str, Any]]:
        """Values by group and name of everything that belongs to planning and the catalogue.

        The same object until a parameter changes; not to be written to.
        """
        return self._planning_values

    def group(self, name: str) -> SettingsGroup:
        """One group of settings at this moment."""
        return self._groups[name]

    @property
    def hand_model(self) -> str:
        """The hand, a name or a file; it cannot change while the node runs."""
        group = self._groups["hand"]
        assert isinstance(group, HandSettings)
        return group.model

    def uses_covariance(self) -> bool:
        """Whether covariances of poses are looked at, at this moment."""
        group = self._groups["uncertainty"]
        assert isinstance(group, UncertaintySettings)
        return group.method != "none"

    def arm_model(self) -> str:
        """Name or file of the arm at this moment; empty without one."""
        group = self._groups["arm"]
        assert isinstance(group, ArmSettings)
        return group.model

    def _refuse_unknown(self) -> None:
        # rclpy ignores an override of an undeclared parameter without a word: a slip of the pen
        # in a parameter file would plan with the default.
        given = getattr(self._node, "_parameter_overrides", {})
        for name in given:
            if name not in self._infos and not name.startswith(BUILT_IN):
                near = difflib.get_close_matches(name, self._infos, 3, cutoff=0.5)
                hint = f"Near are {', '.join(near)}." if near else "docs/parameters.md lists all."
                raise RequestError(f"There is no parameter '{printable(name)}'. {hint}")

    def _declare(self, name: str, info: SettingInfo) -> None:
        default = list(info.default) if info.type is tuple else info.default
        overrides = self._node._parameter_overrides
        if info.type is tuple and name in overrides and overrides[name].value is None:
            # An empty list in a parameter file, as `ros2 param dump` writes it.
            overrides[name] = Parameter(name, Parameter.Type.STRING_ARRAY, [])
        try:
            self._node.declare_parameter(name, default, _descriptor(name, info))
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            given = self._node._parameter_overrides[name].value
            raise RequestError(
                f"Parameter '{name}' was given {given!r:.100}; it takes {IN_WORDS[info.type]}"
                f"{_bounds(info)}. The default is {_written(info.default)}."
            ) from error

    def _built(self, changes: Mapping[str, Any]) -> dict[str, SettingsGroup]:
        """Build all groups from the parameters, with changes by full name. Raises RequestError."""
        groups = {}
        for group, kind in parameter_groups().items():
            prefix = f"{group}." if group else ""
            names = [n for n, i in self._infos.items() if n == prefix + i.name]
            groups[group] = kind.from_mapping(
                {
                    n.removeprefix(prefix): _value(
                        n, self._infos[n], changes.get(n, self._node.get_parameter(n).value)
                    )
                    for n in names
                }
            )
        return groups

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        changes = {p.name: p.value for p in parameters if p.name in self._infos}
        try:
            self._built(changes)
            for name in IMPORTING & changes.keys():
                self._refuse_other_modules(name, changes[name])
        except GraspPlannerError as error:
            return SetParametersResult(successful=False, reason=error.message)
        except Exception as error:
            return SetParametersResult(successful=False, reason=f"{type(error).__name__}: {error}")
        return SetParametersResult(successful=True)

    def _refuse_other_modules(self, name: str, value: Any) -> None:
        """Refuse a module that the parameter does not name now: importing it runs its code."""
        info = self._infos[name]
        now, then = (
            {v for v in _texts(name, info, each) if names_a_module(v)}
            for each in (self._node.get_parameter(name).value, value)
        )
        if then - now:
            raise RequestError(
                f"Parameter '{name}' was given {printable(', '.join(sorted(then - now)), 100)}: a "
                "module is imported only where it is named when the node starts. Start the node "
                "with it, or register it by an entry point."
            )

    def _take(self, _parameters: list[Parameter]) -> None:
        self._groups = self._built({})
        self._planning_values = {n: group.as_dict() for n, group in self._groups.items() if n}


def _descriptor(name: str, info: SettingInfo) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        name=name,
        type=TYPES[info.type],
        description=info.description,
        read_only=name in READ_ONLY,
        # rclpy takes an empty list for bytes, and would refuse strings later.
        dynamic_typing=info.type is tuple,
    )
    if info.choices is not None:
        descriptor.additional_constraints = f"one of {info.range_text()}"
    if info.low is not None and info.high is not None:
        if info.type is float:
            bounds = FloatingPointRange(from_value=float(info.low), to_value=float(info.high))
            descriptor.floating_point_range = [bounds]
        elif info.type is int:
            whole = IntegerRange(from_value=int(info.low), to_value=int(info.high))
            descriptor.integer_range = [whole]
    return descriptor


def _value(name: str, info: SettingInfo, value: Any) -> Any:
    """A parameter's value as the setting takes it; a single text is a list of one."""
    if info.type is not tuple:
        return value
    values = (value,) if isinstance(value, str) else value
    if not isinstance(values, (list, tuple)) or not all(isinstance(v, str) for v in values):
        raise RequestError(
            f"Parameter '{name}' was given {value!r:.100}; it takes {IN_WORDS[tuple]}."
        )
    return tuple(values)


def _texts(name: str, info: SettingInfo, value: Any) -> tuple[str, ...]:
    """The text of a parameter, or all of its list."""
    value = _value(name, info, value)
    return value if isinstance(value, tuple) else (value,)


def _written(default: Any) -> str:
    """A default as one would write it on the command line."""
    if isinstance(default, tuple):
        return str(list(default))
    return str(default).lower() if isinstance(default, bool) else repr(default)


def _bounds(info: SettingInfo) -> str:
    text = info.range_text()
    return "" if text == "any" else f" in {text}"
