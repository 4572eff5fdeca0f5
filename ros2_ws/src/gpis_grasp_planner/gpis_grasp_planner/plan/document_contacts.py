"""The contacts of a grasp in a document: checked all together, one by one where one is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gpis_grasp_planner.plan.json_node import UNIT_TOLERANCE, Node, are_plain
from gpis_grasp_planner.quality.contacts import Contacts

_FIELDS = frozenset({"link", "position", "normal_inward", "friction"})


def read_contacts(node: Node, link_names: Sequence[str]) -> Contacts:
    """The contacts of a grasp; links by their index in `link_names`.

    Raises
    ------
    RequestError
        INVALID_DOCUMENT with the field, its value and what it must be.
    """
    contacts = _plain_contacts(node.value, link_names)
    return _checked_contacts(node, link_names) if contacts is None else contacts


def _plain_contacts(values: Any, link_names: Sequence[str]) -> Contacts | None:
    """Contacts of plain values that are as they must be, all looked at together; else None."""
    try:
        rows = [[*c["position"], *c["normal_inward"], c["friction"]] for c in values]
        links = [link_names.index(c["link"]) for c in values]
        known = all(c.keys() == _FIELDS for c in values)
    except (TypeError, ValueError, KeyError, AttributeError):
        return None
    if not (rows and known and all(len(row) == 7 and are_plain(row) for row in rows)):
        return None
    if not all(len(c["position"]) == 3 for c in values):
        return None
    numbers = np.array(rows)
    lengths = np.linalg.norm(numbers[:, 3:6], axis=1)
    if (np.abs(lengths - 1.0) > UNIT_TOLERANCE).any() or (numbers[:, 6] < 0.0).any():
        return None
    return Contacts(
        positions=numbers[:, :3].copy(),
        normals_inward=numbers[:, 3:6].copy(),
        friction=numbers[:, 6].copy(),
        links=np.array(links, dtype=np.intp),
    )


def _checked_contacts(node: Node, link_names: Sequence[str]) -> Contacts:
    """Contacts read one by one, with an error that names what is wrong."""
    contacts = [item.object(_FIELDS) for item in node.list()]
    if not contacts:
        return Contacts.none()
    for contact in contacts:
        if contact["link"].text() not in link_names:
            raise contact["link"].fail(f"one of {', '.join(link_names)}")
    return Contacts(
        positions=np.stack([c["position"].vector(3) for c in contacts]),
        normals_inward=np.stack([c["normal_inward"].unit_vector(3) for c in contacts]),
        friction=np.array([c["friction"].number(low=0.0) for c in contacts]),
        links=np.array([link_names.index(c["link"].text()) for c in contacts], dtype=np.intp),
    )
