"""The strict reader of grasp documents: every field, its kind and its limits, or INVALID_DOCUMENT.

A document is a file that people edit and programs exchange, and what is read from it moves a
robot: unknown and missing fields, numbers that are not finite, quaternions and normals without
unit length, and joints in another order are errors that name the field.
"""

from __future__ import annotations

import json
import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, RequestError
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.planning.grasp import Grasp
from gpis_grasp_planner.planning.request import PlanRequest, PlanResult
from gpis_grasp_planner.quality.contacts import Contacts

Array = NDArray[np.float64]

SCHEMA = "gpis_grasp_planner/grasps"
SCHEMA_VERSION = 1
UNIT_TOLERANCE = 1e-6
_TEXT_ONLY = ("mesh_hash_recipe", "frame", "quality_recipe")
_FIELDS = frozenset(
    [
        "schema",
        "schema_version",
        "version",
        "code",
        "status",
        "message",
        "mesh_id",
        "mesh_source",
        "mesh_hash",
        "length_unit",
        "center_of_mass",
        "torque_scale",
        "mass",
        "cone_edges",
        "contact_threshold",
        "friction",
        "hand",
        "joint_names",
        "link_names",
        "planner",
        "seed",
        "time_budget_s",
        "n_grasps",
        "max_evaluations",
        "settings",
        "elapsed_s",
        "n_evaluations",
        "convergence",
        "notes",
        "grasps",
        "best_attempt",
    ]
) | set(_TEXT_ONLY)
_GRASP_FIELDS = frozenset(
    [
        "palm_pose",
        "joint_names",
        "joint_positions",
        "pregrasp_joint_positions",
        "approach_direction",
        "approach_distance",
        "contacts",
        "epsilon",
        "volume",
    ]
)


@dataclass(frozen=True)
class MeshSource:
    """A mesh file outside the catalogue: its path as it was given, and its unit if one was."""

    file: str
    unit: str | None = None


class _Node:
    """A value of the document together with the path to it, for messages."""

    def __init__(self, value: Any, path: str, document: str):
        self.value = value
        self.path = path
        self.document = document

    def fail(self, must: str) -> RequestError:
        """Say where, what was found, and what it must be."""
        where = f"'{self.path}'" if self.path else "The document"
        return RequestError(
            f"{self.document}: {where} is {reprlib.repr(self.value)}; it must be {must}.",
            ErrorCode.INVALID_DOCUMENT,
        )

    def object(self, names: frozenset[str]) -> dict[str, _Node]:
        """An object with exactly these fields."""
        if not isinstance(self.value, Mapping):
            raise self.fail(f"an object with the fields {', '.join(sorted(names))}")
        missing = sorted(names - set(self.value))
        unknown = sorted(str(name)[:40] for name in set(self.value) - names)
        if missing or unknown:
            fault = f"lacks {', '.join(missing)}" if missing else f"has unknown {unknown}"
            where = f"'{self.path}'" if self.path else "the document"
            raise RequestError(
                f"{self.document}: {where} {fault}. A document of schema version "
                f"{SCHEMA_VERSION} has exactly the fields of docs/document.md.",
                ErrorCode.INVALID_DOCUMENT,
            )
        prefix = f"{self.path}." if self.path else ""
        return {n: _Node(v, f"{prefix}{n}", self.document) for n, v in self.value.items()}

    def list(self) -> list[_Node]:
        """Return the items of a list."""
        if not isinstance(self.value, list):
            raise self.fail("a list")
        return [_Node(v, f"{self.path}[{i}]", self.document) for i, v in enumerate(self.value)]

    def text(self) -> str:
        """Return a text."""
        if not isinstance(self.value, str):
            raise self.fail("a text")
        return self.value

    def texts(self) -> tuple[str, ...]:
        """Return a list of texts."""
        return tuple(item.text() for item in self.list())

    def number(self, low: float = -math.inf, high: float = math.inf) -> float:
        """A finite number within bounds, both included."""
        value = self.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.fail("a number")
        if not (abs(value) < 1e300 and low <= value <= high):
            raise self.fail(f"a finite number from {low:g} to {high:g}")
        return float(value)

    def integer(self, low: int = 0, high: int = 2**63 - 1) -> int:
        """A whole number within bounds, both included."""
        value = self.value
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise self.fail(f"an integer from {low} to {high}")
        return value

    def vector(self, n: int) -> Array:
        """A list of `n` numbers."""
        items = self.list()
        if len(items) != n:
            raise self.fail(f"a list of {n} numbers")
        return np.array([item.number() for item in items], dtype=float)

    def unit_vector(self, n: int) -> Array:
        """A list of `n` numbers of length 1, normalised to the last digit."""
        vector = self.vector(n)
        length = float(np.linalg.norm(vector))
        if abs(length - 1.0) > UNIT_TOLERANCE:
            raise self.fail(f"of length 1 (it has {length:.9g})")
        return vector

    def optional(self, read: Callable[[_Node], Any]) -> Any:
        """Read null as None, all else by `read`."""
        return None if self.value is None else read(self)


def parse_document(data: bytes, name: str) -> dict[str, Any]:
    """Parse JSON without NaN, infinities and fields given twice.

    Raises
    ------
    RequestError
        INVALID_DOCUMENT.
    """

    def unique(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
        values = dict(pairs)
        if len(values) < len(pairs):
            raise ValueError("a field is given twice")
        return values

    def refuse(constant: str) -> None:
        raise ValueError(f"{constant} is no number of JSON")

    try:
        values = json.loads(data.decode("utf-8"), object_pairs_hook=unique, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise RequestError(
            f"{name} is not valid JSON: {error}. Name a document that 'plan --json' wrote.",
            ErrorCode.INVALID_DOCUMENT,
        ) from None
    document = _Node(values, "", name)
    if not isinstance(values, dict) or values.get("schema") != SCHEMA:
        raise document.fail(f"an object whose schema is '{SCHEMA}'")
    if values.get("schema_version") != SCHEMA_VERSION:
        found = _Node(values.get("schema_version"), "schema_version", name)
        raise found.fail(f"{SCHEMA_VERSION}, the one version this program reads")
    return values


def result_from_dict(
    values: Mapping[str, Any], name: str = "document"
) -> tuple[PlanResult, MeshSource | None]:
    """Check the fields of a document and build the result that it describes.

    Parameters
    ----------
    values : mapping
        Of :func:`parse_document`.
    name : str
        Of the document, for messages.

    Raises
    ------
    RequestError
        INVALID_DOCUMENT with the field, its value and what it must be.
    """
    root = _Node(values, "", name).object(_FIELDS)
    for field in ("version", *_TEXT_ONLY):
        root[field].text()
    if root["length_unit"].text() != "m":
        raise root["length_unit"].fail("'m'")
    code = _code(root)
    mesh_hash = root["mesh_hash"].text()
    if len(mesh_hash) != 64 or not set(mesh_hash) <= set("0123456789abcdef"):
        raise root["mesh_hash"].fail("a SHA-256 as 64 hexadecimal digits")
    joint_names, link_names = root["joint_names"].texts(), root["link_names"].texts()

    def read_grasp(node: _Node) -> Grasp:
        return _grasp(node, joint_names, link_names)

    result = PlanResult(
        code=code,
        message=root["message"].text(),
        grasps=tuple(read_grasp(node) for node in root["grasps"].list()),
        best_attempt=root["best_attempt"].optional(read_grasp),
        mesh_id=root["mesh_id"].text(),
        mesh_hash=mesh_hash,
        center_of_mass=root["center_of_mass"].vector(3),
        torque_scale=root["torque_scale"].number(low=1e-9),
        mass=root["mass"].number(low=0.0),
        cone_edges=root["cone_edges"].integer(3, 1024),
        contact_threshold=root["contact_threshold"].number(low=0.0),
        friction=_friction(root["friction"]),
        hand=root["hand"].text(),
        link_names=link_names,
        joint_names=joint_names,
        request=_request(root),
        settings=_settings(root["settings"]),
        elapsed_s=root["elapsed_s"].number(low=0.0),
        evaluations=root["n_evaluations"].integer(),
        notes=root["notes"].texts(),
        convergence=tuple(_improvement(node) for node in root["convergence"].list()),
    )
    return result, root["mesh_source"].optional(_mesh_source)


def _code(root: Mapping[str, _Node]) -> ErrorCode:
    names = {int(code): code for code in ErrorCode}
    code = names.get(root["code"].integer())
    if code is None:
        raise root["code"].fail("a code of ErrorCode (errors.py)")
    if root["status"].text() != code.name:
        raise root["status"].fail(f"{code.name}, the name of the code {int(code)}")
    if (code == ErrorCode.SUCCESS) != bool(root["grasps"].list()) and code != ErrorCode.CANCELLED:
        raise root["code"].fail("SUCCESS exactly where there are grasps")
    return code


def _request(root: Mapping[str, _Node]) -> PlanRequest:
    try:
        return PlanRequest(
            planner=root["planner"].text(),
            seed=root["seed"].integer(),
            time_budget_s=root["time_budget_s"].number(),
            n_grasps=root["n_grasps"].integer(),
            friction=_friction(root["friction"]),
            max_evaluations=root["max_evaluations"].optional(_Node.integer),
        )
    except GraspPlannerError as error:
        if error.code == ErrorCode.INVALID_DOCUMENT:
            raise
        raise RequestError(
            f"{root['seed'].document}: {error}", ErrorCode.INVALID_DOCUMENT
        ) from None


def _friction(node: _Node) -> Friction:
    pair = node.object(frozenset({"finger", "palm"}))
    return Friction(pair["finger"].number(low=0.0), pair["palm"].number(low=0.0))


def _mesh_source(node: _Node) -> MeshSource:
    source = node.object(frozenset({"file", "unit"}))
    unit = source["unit"].optional(_Node.text)
    if unit not in (None, "m", "mm"):
        raise source["unit"].fail("'m', 'mm' or null")
    return MeshSource(source["file"].text(), unit)


def _settings(node: _Node) -> dict[str, dict[str, Any]]:
    groups = node.value
    if not isinstance(groups, Mapping) or not all(isinstance(g, Mapping) for g in groups.values()):
        raise node.fail("groups of names and values")
    return {group: dict(values) for group, values in groups.items()}


def _improvement(node: _Node) -> tuple[float, int, float]:
    entry = node.object(frozenset({"elapsed_s", "n_evaluations", "best_epsilon"}))
    return (
        entry["elapsed_s"].number(low=0.0),
        entry["n_evaluations"].integer(),
        entry["best_epsilon"].number(low=-1.0),
    )


def _grasp(node: _Node, joint_names: Sequence[str], link_names: Sequence[str]) -> Grasp:
    grasp = node.object(_GRASP_FIELDS)
    if grasp["joint_names"].texts() != tuple(joint_names):
        raise grasp["joint_names"].fail("the document's joint_names, in their order")
    pose = grasp["palm_pose"].object(frozenset({"position", "orientation_xyzw"}))
    n = len(joint_names)
    return Grasp(
        T_object_palm=from_position_quat_xyzw(
            pose["position"].vector(3), pose["orientation_xyzw"].unit_vector(4)
        ),
        joints=grasp["joint_positions"].vector(n),
        pregrasp_joints=grasp["pregrasp_joint_positions"].vector(n),
        contacts=_contacts(grasp["contacts"], link_names),
        epsilon=grasp["epsilon"].number(low=-1.0),
        volume=grasp["volume"].number(low=0.0),
        approach_direction=grasp["approach_direction"].unit_vector(3),
        approach_distance=grasp["approach_distance"].number(low=0.0),
    )


def _contacts(node: _Node, link_names: Sequence[str]) -> Contacts:
    names = frozenset({"link", "position", "normal_inward", "friction"})
    contacts = [item.object(names) for item in node.list()]
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
