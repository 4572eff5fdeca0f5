"""Contacts looked at together are those read one by one; what is wrong is told all the same."""

from __future__ import annotations

import copy
import math

import numpy as np
import pytest

from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.plan.document_contacts import (
    _checked_contacts,
    _plain_contacts,
    read_contacts,
)
from gpis_grasp_planner.plan.json_node import Node

LINKS = ("palm", "inner", "distal")


@pytest.fixture
def values(rng):
    normals = rng.normal(size=(5, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return [
        {
            "link": LINKS[int(rng.integers(3))],
            "position": rng.normal(size=3).tolist(),
            "normal_inward": normal.tolist(),
            "friction": float(rng.uniform(0.1, 1.0)),
        }
        for normal in normals
    ]


def test_both_ways_read_the_same(values):
    together = _plain_contacts(values, LINKS)
    one_by_one = _checked_contacts(Node(values, "contacts", "test"), LINKS)
    for name in ("positions", "normals_inward", "friction", "links"):
        np.testing.assert_array_equal(getattr(together, name), getattr(one_by_one, name))


def test_whole_numbers_and_no_contacts_are_read(values):
    values[0] |= {"position": [0, 1, 2], "normal_inward": [0, 0, 1], "friction": 1}
    found = read_contacts(Node(values, "contacts", "test"), LINKS)
    np.testing.assert_array_equal(found.positions[0], [0.0, 1.0, 2.0])
    assert len(read_contacts(Node([], "contacts", "test"), LINKS).friction) == 0


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("link", "thumb"),
        ("link", 3),
        ("position", [0.0, 1.0]),
        ("position", [0.0, 1.0, math.nan]),
        ("position", [0.0, 1.0, True]),
        ("position", [0.0, 1e301, 0.0]),
        ("position", "abc"),
        ("normal_inward", [0.0, 0.0, 1.001]),
        ("normal_inward", [1.0]),
        ("friction", -0.1),
        ("friction", None),
        ("more", 1.0),
    ],
)
def test_what_is_wrong_is_told(values, field, value):
    bad = copy.deepcopy(values)
    bad[2][field] = value
    with pytest.raises(RequestError) as error:
        read_contacts(Node(bad, "contacts", "test"), LINKS)
    assert error.value.code == ErrorCode.INVALID_DOCUMENT
    assert "contacts[2]" in error.value.message


def test_a_number_moved_from_one_vector_to_the_next_is_wrong(values):
    values[0]["position"].append(values[0]["normal_inward"].pop(0))
    with pytest.raises(RequestError):
        read_contacts(Node(values, "contacts", "test"), LINKS)
