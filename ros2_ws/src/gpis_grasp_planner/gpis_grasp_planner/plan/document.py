"""A plan as a JSON document: grasps with the evidence from which every figure can be recomputed.

Lengths are in metres and angles in radians whatever the unit of the mesh file; poses, contacts
and the centre of mass are in the mesh file's own frame. ``docs/document.md`` lists the fields,
:mod:`~gpis_grasp_planner.plan.document_reader` reads and checks them.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gpis_grasp_planner import __version__
from gpis_grasp_planner.errors import ErrorCode, RequestError
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.geometry.transforms import to_position_quat_xyzw
from gpis_grasp_planner.grasp.arm_motion import ArmMotion
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.plan.document_reader import (
    SCHEMA,
    SCHEMA_VERSION,
    MeshSource,
    parse_document,
    result_from_dict,
)
from gpis_grasp_planner.plan.request import PlanResult

__all__ = [
    "MAX_DOCUMENT_BYTES",
    "GraspDocument",
    "MeshSource",
    "check_same_mesh",
    "document_of",
    "document_text",
    "read_document",
    "write_document",
]

MAX_DOCUMENT_BYTES = 64_000_000

FRAME = (
    "The mesh file's own frame. All lengths are in metres, also where the file is in millimetres: "
    "divide such a file's coordinates by 1000."
)
HASH_RECIPE = (
    "SHA-256 (hex) of the mesh as it was planned on, in metres after merging equal vertices and "
    "the repairs in the notes: all vertices as little-endian float64 (x, y, z), then all faces as "
    "little-endian int32."
)
QUALITY_RECIPE = (
    "Edge j of m of a contact's pyramid: n + mu (cos(2 pi j / m) t_x + sin(2 pi j / m) t_y), with "
    "n the inward normal, t_y = n x e_x normalised (e_z where n is along x) and t_x = t_y x n. Its "
    "wrench: [f; (p - center_of_mass) x f / torque_scale]. The hull of all wrenches gives "
    "epsilon, the distance of the origin from the nearest facet (-1 outside), and the 6-D volume."
)


@dataclass(frozen=True, eq=False)
class GraspDocument:
    """A document as read: the result, where its mesh came from, and who wrote it."""

    result: PlanResult
    mesh_source: MeshSource | None
    version: str


def document_of(result: PlanResult, mesh_source: MeshSource | None = None) -> dict[str, Any]:
    """Put a result into plain values, ready for JSON.

    Parameters
    ----------
    result : PlanResult
    mesh_source : MeshSource, optional
        The file, for meshes outside the catalogue; None means that `mesh_id` is a catalogue ID.
    """
    request = result.request
    best = result.best_attempt
    return {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "version": __version__,
        "code": int(result.code),
        "status": result.code.name,
        "message": result.message,
        "mesh_id": result.mesh_id,
        "mesh_source": None
        if mesh_source is None
        else {
            "file": mesh_source.file,
            "unit": mesh_source.unit,
            **({} if mesh_source.body is None else {"body": mesh_source.body}),
        },
        "mesh_hash": result.mesh_hash,
        "mesh_hash_recipe": HASH_RECIPE,
        "frame": FRAME,
        "length_unit": "m",
        "center_of_mass": _numbers(result.center_of_mass),
        "torque_scale": float(result.torque_scale),
        "mass": float(result.mass),
        "cone_edges": int(result.cone_edges),
        "contact_threshold": float(result.contact_threshold),
        "quality_recipe": QUALITY_RECIPE,
        "friction": {"finger": result.friction.finger, "palm": result.friction.palm},
        "hand": result.hand,
        "joint_names": list(result.joint_names),
        "open_hand": {
            "zero": _numbers(result.joint_count.zero),
            "sense": _numbers(result.joint_count.sense),
        },
        "link_names": list(result.link_names),
        "objective": result.objective,
        "figures": [asdict(figure) for figure in result.figures],
        "planner": request.planner,
        "seed": request.seed,
        "time_budget_s": request.time_budget_s,
        "n_grasps": request.n_grasps,
        "max_evaluations": request.max_evaluations,
        "verification": request.verification,
        "approach": None if request.approach is None else request.approach.as_mapping(),
        "forbidden": [region.as_mapping() for region in request.forbidden],
        "settings": {group: dict(values) for group, values in result.settings.items()},
        "elapsed_s": float(result.elapsed_s),
        "n_evaluations": int(result.evaluations),
        "convergence": [
            {"elapsed_s": float(t), "n_evaluations": int(n), "best_epsilon": float(epsilon)}
            for t, n, epsilon in result.convergence
        ],
        "phase_s": {phase: float(spent) for phase, spent in result.phase_s.items()},
        "funnel": [
            {"step": str(step), "left": left, "lost": causes}
            for step, left, causes in result.funnel.table
            if result.funnel.proposed
        ],
        "lost_palms": [
            {"step": str(step), "cause": cause, "positions": [_numbers(p.round(5)) for p in rows]}
            for (step, cause), rows in result.lost_palms.positions.items()
        ],
        "notes": list(result.notes),
        "place": result.place,
        "grasps": [_grasp(g, result) for g in result.grasps],
        "best_attempt": None if best is None else _grasp(best, result),
    }


def document_text(result: PlanResult, mesh_source: MeshSource | None = None) -> str:
    """Write a result as JSON text; numbers keep all their digits, and there is no NaN."""
    return json.dumps(document_of(result, mesh_source), indent=1, allow_nan=False) + "\n"


def write_document(path: Path, result: PlanResult, mesh_source: MeshSource | None = None) -> None:
    """Write the document of a result to a file."""
    path.write_text(document_text(result, mesh_source), encoding="utf-8")


def read_document(path: Path) -> GraspDocument:
    """Read a document and check all of it.

    Raises
    ------
    RequestError
        INVALID_DOCUMENT with the field, its value and what it must be.
    """
    try:
        size = path.stat().st_size
        data = path.read_bytes() if size <= MAX_DOCUMENT_BYTES else b""
    except OSError as error:
        raise _invalid(
            f"Cannot read {path}: {error.strerror}. Name a document of 'plan'."
        ) from None
    if size > MAX_DOCUMENT_BYTES:
        raise _invalid(f"{path} has {size} bytes; the limit is {MAX_DOCUMENT_BYTES}.")
    values = parse_document(data, path.name)
    result, mesh_source = result_from_dict(values, path.name)
    return GraspDocument(result, mesh_source, values["version"])


def check_same_mesh(result: PlanResult, part: Part) -> None:
    """Refuse a part that is not the one the document was made for.

    Raises
    ------
    RequestError
        INVALID_DOCUMENT with both hashes.
    """
    if part.mesh.content_hash != result.mesh_hash:
        raise _invalid(
            f"The mesh '{part.mesh_id}' has the hash {part.mesh.content_hash[:16]}..., the "
            f"document was made for {result.mesh_hash[:16]}.... Give the mesh of the document "
            "with --mesh (and its --unit), or plan anew."
        )


def _grasp(grasp: Grasp, result: PlanResult) -> dict[str, Any]:
    of_urdf, link_names = result.joint_count.of_urdf, result.link_names
    position, quat_xyzw = to_position_quat_xyzw(grasp.T_object_palm)
    contacts = grasp.contacts
    return {
        "palm_pose": {"position": _numbers(position), "orientation_xyzw": _numbers(quat_xyzw)},
        "joint_names": list(result.joint_names),
        "joint_positions": _numbers(of_urdf(grasp.joints)),
        "pregrasp_joint_positions": _numbers(of_urdf(grasp.pregrasp_joints)),
        "approach_direction": _numbers(grasp.approach_direction),
        "approach_distance": float(grasp.approach_distance),
        "contacts": [
            {
                "link": link_names[int(link)],
                "position": _numbers(position),
                "normal_inward": _numbers(normal),
                "friction": float(friction),
            }
            for position, normal, friction, link in zip(
                contacts.positions,
                contacts.normals_inward,
                contacts.friction,
                contacts.links,
                strict=True,
            )
        ],
        "epsilon": float(grasp.epsilon),
        "volume": float(grasp.volume),
        "measured": {name: float(value) for name, value in grasp.quality.measured.items()},
        "hold_probability": grasp.hold_probability,
        "lift_direction": None if grasp.lift_direction is None else _numbers(grasp.lift_direction),
        "imbalance": grasp.imbalance,
        "hold_estimate": None if grasp.hold_estimate is None else asdict(grasp.hold_estimate),
        "arm": None if grasp.arm is None else _arm(grasp.arm),
        "trials": None
        if grasp.trials is None
        else [asdict(outcome) for outcome in grasp.trials.outcomes],
    }


def _arm(motion: ArmMotion) -> dict[str, Any]:
    return {
        "model": motion.arm,
        "joint_names": list(motion.joint_names),
        "approach": [_numbers(joints) for joints in motion.approach],
        "lift": [_numbers(joints) for joints in motion.lift],
        "manipulability": float(motion.manipulability),
        "worth": float(motion.worth),
    }


def _numbers(values: Any) -> list[float]:
    return [float(v) for v in np.asarray(values, dtype=float)]


def _invalid(message: str) -> RequestError:
    return RequestError(message, ErrorCode.INVALID_DOCUMENT)
