"""The strict reader of grasp documents: every field, its kind and its limits, or INVALID_DOCUMENT.

A document is a file that people edit and programs exchange, and what is read from it moves a
robot: unknown and missing fields, numbers that are not finite, quaternions and normals without
unit length, and joints in another order are errors that name the field.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, RequestError
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.geometry.units import UNITS, known_units
from gpis_grasp_planner.grasp.arm_motion import ArmMotion
from gpis_grasp_planner.grasp.funnel import Funnel, Step
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.lost_palms import LostPalms
from gpis_grasp_planner.grasp.trials import HoldEstimate, TrialOutcome, Trials
from gpis_grasp_planner.hand.open_hand import JointCount
from gpis_grasp_planner.plan.document_contacts import read_contacts
from gpis_grasp_planner.plan.document_joints import read_joint_count
from gpis_grasp_planner.plan.json_node import Node
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
from gpis_grasp_planner.quality.figures import ALWAYS, Figure, Quality
from gpis_grasp_planner.surroundings.approach_cone import ApproachCone
from gpis_grasp_planner.surroundings.forbidden_region import read_regions
from gpis_grasp_planner.surroundings.place import STAND_IN, Place

SCHEMA = "gpis_grasp_planner/grasps"
SCHEMA_VERSION = 2
_TEXT_ONLY = ("mesh_hash_recipe", "frame", "quality_recipe")
_FIELDS = frozenset(
    (
        "schema", "schema_version", "version", "code", "status", "message", "mesh_id",
        "mesh_source", "mesh_hash", "length_unit", "center_of_mass", "torque_scale", "mass",
        "cone_edges", "contact_threshold", "friction", "hand", "joint_names", "link_names",
        "planner", "seed", "time_budget_s", "n_grasps", "max_evaluations", "verification",
        "settings", "elapsed_s", "n_evaluations", "convergence", "notes", "place", "grasps",
        "best_attempt", "approach", "forbidden", "phase_s", "funnel", "objective", "figures",
        "lost_palms", "open_hand",
    )
) | set(_TEXT_ONLY)  # fmt: skip
# What earlier programs did not write.
_LATER: dict[str, Any] = {
    "approach": None, "forbidden": [], "phase_s": {}, "funnel": [], "objective": "",
    "lost_palms": [], "open_hand": None,
    "figures": [asdict(figure) for figure in ALWAYS],
}  # fmt: skip
_LATER_OF_GRASPS: dict[str, Any] = {
    "imbalance": None,
    "hold_estimate": None,
    "measured": {},
    "arm": None,
}
_LATER_OF_TRIALS: dict[str, Any] = {"closing_slip_m": 0.0, "closing_rotation_rad": 0.0}
_GRASP_FIELDS = frozenset(
    (
        "palm_pose", "joint_names", "joint_positions", "pregrasp_joint_positions",
        "approach_direction", "approach_distance", "contacts", "epsilon", "volume", "trials",
        "hold_probability", "lift_direction", "imbalance", "hold_estimate", "measured", "arm",
    )
)  # fmt: skip


@dataclass(frozen=True)
class MeshSource:
    """A mesh file outside the catalogue: its path as it was given, its unit and body if one was."""

    file: str
    unit: str | None = None
    body: str | None = None


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
    check_schema(values, name)
    document: dict[str, Any] = values
    return document


def check_schema(values: Any, name: str) -> None:
    """Refuse what is no document, or one of another version; raises as :func:`parse_document`."""
    document = Node(values, "", name)
    if not isinstance(values, dict) or values.get("schema") != SCHEMA:
        raise document.fail(f"an object whose schema is '{SCHEMA}'")
    if values.get("schema_version") != SCHEMA_VERSION:
        found = Node(values.get("schema_version"), "schema_version", name)
        raise found.fail(f"{SCHEMA_VERSION}, the one version this program reads")


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
    root = Node(values, "", name).object(_FIELDS, _LATER)
    for field in ("version", *_TEXT_ONLY):
        root[field].text()
    if root["length_unit"].text() != "m":
        raise root["length_unit"].fail("'m'")
    code = _code(root)
    mesh_hash = root["mesh_hash"].text()
    if len(mesh_hash) != 64 or not set(mesh_hash) <= set("0123456789abcdef"):
        raise root["mesh_hash"].fail("a SHA-256 as 64 hexadecimal digits")
    joint_names, link_names = root["joint_names"].texts(), root["link_names"].texts()
    count = read_joint_count(root["open_hand"], len(joint_names))

    figures = tuple(_figure(node) for node in root["figures"].list())
    known = {figure.name for figure in figures}

    def read_grasp(node: Node) -> Grasp:
        grasp = _grasp(node, joint_names, count, link_names)
        if unknown := sorted(set(grasp.quality.measured) - known):
            raise node.fail(f"of figures that the document's 'figures' name, not {unknown}")
        return grasp

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
        joint_count=count,
        request=_request(root),
        settings=_settings(root["settings"]),
        elapsed_s=root["elapsed_s"].number(low=0.0),
        evaluations=root["n_evaluations"].integer(),
        notes=root["notes"].texts(),
        convergence=tuple(_improvement(node) for node in root["convergence"].list()),
        place=root["place"].optional(_place),
        phase_s={phase: spent.number(low=0.0) for phase, spent in _named(root["phase_s"]).items()},
        funnel=_funnel(root["funnel"]),
        lost_palms=_lost_palms(root["lost_palms"]),
        objective=root["objective"].text(),
        figures=figures,
    )
    return result, root["mesh_source"].optional(_mesh_source)


def _code(root: Mapping[str, Node]) -> ErrorCode:
    names = {int(code): code for code in ErrorCode}
    code = names.get(root["code"].integer())
    if code is None:
        raise root["code"].fail("a code of ErrorCode (errors.py)")
    if root["status"].text() != code.name:
        raise root["status"].fail(f"{code.name}, the name of the code {int(code)}")
    if (code == ErrorCode.SUCCESS) != bool(root["grasps"].list()) and code != ErrorCode.CANCELLED:
        raise root["code"].fail("SUCCESS exactly where there are grasps")
    return code


def _request(root: Mapping[str, Node]) -> PlanRequest:
    try:
        return PlanRequest(
            planner=root["planner"].text(),
            seed=root["seed"].integer(),
            time_budget_s=root["time_budget_s"].number(),
            n_grasps=root["n_grasps"].integer(),
            friction=_friction(root["friction"]),
            max_evaluations=root["max_evaluations"].optional(Node.integer),
            verification=root["verification"].text(),
            approach=root["approach"].optional(lambda node: ApproachCone.from_mapping(node.value)),
            forbidden=read_regions(root["forbidden"].value),
        )
    except GraspPlannerError as error:
        if error.code == ErrorCode.INVALID_DOCUMENT:
            raise
        raise RequestError(
            f"{root['seed'].document}: {error}", ErrorCode.INVALID_DOCUMENT
        ) from None


def _friction(node: Node) -> Friction:
    pair = node.object(frozenset({"finger", "palm"}))
    return Friction(pair["finger"].number(low=0.0), pair["palm"].number(low=0.0))


def _mesh_source(node: Node) -> MeshSource:
    has_body = isinstance(node.value, dict) and "body" in node.value
    source = node.object(frozenset({"file", "unit"} | ({"body"} if has_body else set())))
    unit = source["unit"].optional(Node.text)
    if unit is not None and unit not in UNITS:
        raise source["unit"].fail(f"one of {known_units()}, or null")
    return MeshSource(
        source["file"].text(), unit, source["body"].optional(Node.text) if has_body else None
    )


def _place(node: Node) -> dict[str, Any]:
    try:
        Place.from_mapping(node.value, lambda _source: STAND_IN)
    except GraspPlannerError as error:
        raise RequestError(
            f"{node.document}: '{node.path}': {error}", ErrorCode.INVALID_DOCUMENT
        ) from None
    return dict(node.value)


def _settings(node: Node) -> dict[str, dict[str, Any]]:
    groups = node.value
    if not isinstance(groups, Mapping) or not all(isinstance(g, Mapping) for g in groups.values()):
        raise node.fail("groups of names and values")
    return {group: dict(values) for group, values in groups.items()}


def _named(node: Node) -> dict[str, Node]:
    """The values of an object of any names."""
    if not isinstance(node.value, Mapping):
        raise node.fail("names with numbers")
    return {
        name: Node(value, f"{node.path}.{name}", node.document)
        for name, value in node.value.items()
    }


def _funnel(node: Node) -> Funnel:
    rows = [item.object(frozenset({"step", "left", "lost"})) for item in node.list()]
    if not rows:
        return Funnel()
    try:
        return Funnel.of_table(
            (
                row["step"].text(),
                row["left"].integer(),
                {cause: n.integer(low=1) for cause, n in _named(row["lost"]).items()},
            )
            for row in rows
        )
    except ValueError as error:
        raise node.fail(f"the table of a funnel ({error})") from None


def _lost_palms(node: Node) -> LostPalms:
    positions = {}
    for entry in node.list():
        row = entry.object(frozenset({"step", "cause", "positions"}))
        step, cause = row["step"].text(), row["cause"].text()
        if step not in set(Step) or (Step(step), cause) in positions:
            raise row["step"].fail(f"one of {', '.join(Step)}, each cause of a step once")
        rows = [point.vector(3) for point in row["positions"].list()]
        positions[Step(step), cause] = np.array(rows).reshape(-1, 3)
    return LostPalms(positions)


def _figure(node: Node) -> Figure:
    figure = node.object(frozenset(field.name for field in fields(Figure)))
    return Figure(
        figure["name"].text(),
        figure["unit"].text(),
        figure["larger_is_better"].boolean(),
        figure["description"].text(),
        figure["source"].text(),
    )


def _improvement(node: Node) -> tuple[float, int, float]:
    entry = node.object(frozenset({"elapsed_s", "n_evaluations", "best_epsilon"}))
    return (
        entry["elapsed_s"].number(low=0.0),
        entry["n_evaluations"].integer(),
        entry["best_epsilon"].number(low=-1.0),
    )


def _grasp(
    node: Node, joint_names: Sequence[str], count: JointCount, link_names: Sequence[str]
) -> Grasp:
    grasp = node.object(_GRASP_FIELDS, _LATER_OF_GRASPS)
    if grasp["joint_names"].texts() != tuple(joint_names):
        raise grasp["joint_names"].fail("the document's joint_names, in their order")
    pose = grasp["palm_pose"].object(frozenset({"position", "orientation_xyzw"}))
    n = len(joint_names)
    return Grasp(
        T_object_palm=from_position_quat_xyzw(
            pose["position"].vector(3), pose["orientation_xyzw"].unit_vector(4)
        ),
        joints=count.of_planner(grasp["joint_positions"].vector(n)),
        pregrasp_joints=count.of_planner(grasp["pregrasp_joint_positions"].vector(n)),
        contacts=read_contacts(grasp["contacts"], link_names),
        quality=Quality(
            grasp["epsilon"].number(low=-1.0),
            grasp["volume"].number(low=0.0),
            grasp["imbalance"].optional(lambda node: node.number(low=0.0)),
            {name: value.number() for name, value in _named(grasp["measured"]).items()},
        ),
        approach_direction=grasp["approach_direction"].unit_vector(3),
        approach_distance=grasp["approach_distance"].number(low=0.0),
        trials=grasp["trials"].optional(_trials),
        hold_probability=grasp["hold_probability"].optional(lambda node: node.number(0.0, 1.0)),
        lift_direction=grasp["lift_direction"].optional(lambda node: node.unit_vector(3)),
        hold_estimate=grasp["hold_estimate"].optional(_hold_estimate),
        arm=grasp["arm"].optional(_arm),
    )


def _arm(node: Node) -> ArmMotion:
    arm = node.object(
        frozenset({"model", "joint_names", "approach", "lift", "manipulability", "worth"})
    )
    names = arm["joint_names"].texts()

    def way(field: Node) -> NDArray[np.float64]:
        joints = [entry.vector(len(names)) for entry in field.list()]
        if not joints:
            raise field.fail("at least one vector of the arm's joints")
        return np.array(joints)

    return ArmMotion(
        arm["model"].text(),
        names,
        way(arm["approach"]),
        way(arm["lift"]),
        arm["manipulability"].number(0.0, 1.0),
        arm["worth"].number(low=0.0),
    )


def _hold_estimate(node: Node) -> HoldEstimate:
    estimate = node.object(frozenset(field.name for field in fields(HoldEstimate)))
    probability, low, high = (
        estimate[name].number(0.0, 1.0) for name in ("probability", "low", "high")
    )
    return HoldEstimate(probability, low, high, estimate["n"].integer())


def _trials(node: Node) -> Trials:
    names = frozenset(field.name for field in fields(TrialOutcome))
    outcomes = [item.object(names, _LATER_OF_TRIALS) for item in node.list()]
    return Trials(
        tuple(
            TrialOutcome(
                outcome["name"].text(),
                outcome["passed"].boolean(),
                outcome["cause"].text(),
                outcome["slip_m"].number(low=0.0),
                outcome["rotation_rad"].number(low=0.0),
                outcome["closing_slip_m"].number(low=0.0),
                outcome["closing_rotation_rad"].number(low=0.0),
            )
            for outcome in outcomes
        )
    )
