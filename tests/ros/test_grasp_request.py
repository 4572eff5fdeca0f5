"""The fields that service and action share are all of both, with one type each."""

from __future__ import annotations

import typing

import pytest

from gpis_grasp_msgs import action, srv
from gpis_grasp_planner.ros.grasp_request import GraspRequest

KINDS = [srv.PlanGrasp.Request, action.PlanGrasp.Goal]


@pytest.mark.parametrize("kind", KINDS)
def test_the_fields_are_exactly_those_of_the_message(kind: typing.Any) -> None:
    assert set(typing.get_type_hints(GraspRequest)) == set(kind.get_fields_and_field_types())


@pytest.mark.parametrize("kind", KINDS)
def test_a_message_holds_what_the_annotation_says(kind: typing.Any) -> None:
    message = kind()
    for name, declared in typing.get_type_hints(GraspRequest).items():
        wanted = typing.get_origin(declared) or declared
        assert isinstance(getattr(message, name), wanted), name


def test_service_and_action_declare_the_fields_alike() -> None:
    request, goal = (kind.get_fields_and_field_types() for kind in KINDS)
    assert request == goal
