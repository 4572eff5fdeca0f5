"""The YAML file beside a mesh: what the mesh itself does not say. Every key is optional.

Strict: an unknown key, a key given twice or a value of the wrong kind is an error that names
what is allowed, because a misspelt ``unit`` would otherwise be a part a thousand times too large.
"""

from __future__ import annotations

import math
import re
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from gpis_grasp_planner.errors import ErrorCode, MeshError
from gpis_grasp_planner.geometry.materials import MATERIALS
from gpis_grasp_planner.geometry.part import FRICTION_RANGE, Friction
from gpis_grasp_planner.geometry.symmetry import MOST_TURNS, SymmetryGroup, Turn
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw
from gpis_grasp_planner.geometry.units import UNITS, known_units

Array = NDArray[np.float64]

MAX_SIDECAR_BYTES = 64_000
KEYS = (
    "unit", "mass", "density", "center_of_mass", "friction", "material", "description", "scale",
    "body", "estimator_frame", "symmetries", "viewpoints",
)  # fmt: skip
MAX_MASS_KG = 1000.0
MAX_DENSITY_KG_M3 = 30_000.0
SCALE_RANGE = (1e-9, 1e9)
MAX_COORDINATE_M = 10.0
QUATERNION_TOLERANCE = 1e-3
MOST_SYMMETRIES = 8
MOST_VIEWPOINTS = 100
MIN_AXIS = 1e-6


@dataclass(frozen=True, eq=False)
class Sidecar:
    """What a sidecar says; None where it says nothing.

    Attributes
    ----------
    unit : str or None
        One of `units.UNITS`.
    mass : float or None [kg]
    density : float or None [kg/m^3]; the material's if only that is named
    center_of_mass : (3,) array or None [m], in the mesh file's frame
    friction : Friction or None; the material's if only that is named
    scale : float or None
        The file's numbers are multiplied by it.
    body : str or int or None
        The name, or the number from 1, of the one body of the file that is the part.
    T_mesh_estimator : (4, 4) array or None
        Pose of the frame whose pose an estimator tells, in the mesh file's frame [m].
    symmetry : SymmetryGroup or None
        Turns that bring the part onto itself.
    viewpoints : (k, 3) array or None [m]
        Where the sensor of a point cloud stood, in the file's frame.
    """

    unit: str | None = None
    mass: float | None = None
    density: float | None = None
    center_of_mass: Array | None = None
    friction: Friction | None = None
    scale: float | None = None
    body: str | int | None = None
    T_mesh_estimator: Array | None = None
    symmetry: SymmetryGroup | None = None
    viewpoints: Array | None = None


class _StrictLoader(yaml.SafeLoader):
    """Safe YAML in which a key given twice is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            key = getattr(key_node, "value", None)
            if isinstance(key, str) and key in seen:
                raise yaml.constructor.ConstructorError(
                    problem=f"key '{key[:40]}' is given twice", problem_mark=key_node.start_mark
                )
            if isinstance(key, str):
                seen.add(key)
        return super().construct_mapping(node, deep=deep)


# YAML 1.1 takes 1e-3 for a text because it lacks a point and a sign; YAML 1.2 does not.
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)


def parse_sidecar(data: bytes, name: str) -> Sidecar:
    """Validate the bytes of a sidecar called `name`; MESH_SIDECAR_INVALID names what is wrong."""
    if len(data) > MAX_SIDECAR_BYTES:
        raise _invalid(name, f"has {len(data)} bytes, the limit is {MAX_SIDECAR_BYTES}")
    try:
        # _StrictLoader is a SafeLoader: it builds plain values only.
        content = yaml.load(data.decode("utf-8"), Loader=_StrictLoader)
    except (yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or type(error).__name__
        raise _invalid(name, f"is not valid YAML ({problem}{where})") from None
    if content is None:
        return Sidecar()
    if not isinstance(content, Mapping):
        raise _invalid(name, f"must be keys and values, such as 'unit: mm'; known: {_list(KEYS)}")
    unknown = sorted(reprlib.repr(k) for k in content if k not in KEYS)
    if unknown:
        raise _invalid(name, f"has the unknown key {_list(unknown)}; known are {_list(KEYS)}")
    return _sidecar(content, name)


def _sidecar(content: Mapping[str, Any], name: str) -> Sidecar:
    unit = content.get("unit")
    if unit is not None and (not isinstance(unit, str) or unit not in UNITS):
        raise _invalid(name, f"has unit {reprlib.repr(unit)}; choose one of {known_units()}")
    if "mass" in content and "density" in content:
        raise _invalid(name, "gives both mass and density; keep one")
    material = content.get("material")
    if material is not None and (not isinstance(material, str) or material not in MATERIALS):
        raise _invalid(
            name,
            f"has material {reprlib.repr(material)}; known are {_list(MATERIALS)}. Others: give "
            "density and friction instead",
        )
    known = MATERIALS.get(material) if material is not None else None
    mass = density = None
    if "mass" in content:
        mass = _number(content["mass"], "mass", "kg", MAX_MASS_KG, name)
    elif "density" in content:
        density = _number(content["density"], "density", "kg/m3", MAX_DENSITY_KG_M3, name)
    elif known is not None:
        density = known.density
    friction = known.friction if known is not None else None
    if "friction" in content:
        friction = _friction(content["friction"], name)
    center = content.get("center_of_mass")
    if not isinstance(content.get("description", ""), str):
        raise _invalid(name, "has a description that is not a text")
    return Sidecar(
        unit,
        mass,
        density,
        None if center is None else _point(center, name),
        friction,
        _scale(content["scale"], name) if "scale" in content else None,
        _body(content["body"], name) if "body" in content else None,
        _estimator_frame(content["estimator_frame"], name)
        if "estimator_frame" in content
        else None,
        _symmetry(content["symmetries"], name) if "symmetries" in content else None,
        _viewpoints(content["viewpoints"], name) if "viewpoints" in content else None,
    )


def _scale(value: Any, name: str) -> float:
    low, high = SCALE_RANGE
    if not _is_number(value) or not low <= value <= high:
        raise _invalid(name, f"has scale {reprlib.repr(value)}; it must be {low:g} to {high:g}")
    return float(value)


def _body(value: Any, name: str) -> str | int:
    if isinstance(value, bool) or not isinstance(value, str | int) or value in ("", 0):
        raise _invalid(
            name, f"has body {reprlib.repr(value)}; give a body's name, or its number from 1"
        )
    return value


def _friction(value: Any, name: str) -> Friction:
    if not isinstance(value, Mapping):
        mu = _coefficient(value, "friction", name)
        return Friction(mu, mu)
    if set(value) != {"finger", "palm"}:
        raise _invalid(name, "must give friction as one number, or as both finger and palm")
    finger = _coefficient(value["finger"], "friction of the finger", name)
    return Friction(finger, _coefficient(value["palm"], "friction of the palm", name))


def _coefficient(value: Any, what: str, name: str) -> float:
    low, high = FRICTION_RANGE
    if not _is_number(value) or not low <= value <= high:
        raise _invalid(name, f"has {what} {reprlib.repr(value)}; it must be {low:g} to {high:g}")
    return float(value)


def _estimator_frame(value: Any, name: str) -> Array:
    """T_mesh_estimator of a position in m and an orientation; either may be left out."""
    keys = {"position", "orientation_xyzw"}
    if not isinstance(value, Mapping) or not value or not set(value) <= keys:
        raise _invalid(
            name,
            f"has estimator_frame {reprlib.repr(value)}; give position [x, y, z] in m and "
            "orientation_xyzw [x, y, z, w], or one of them",
        )
    position = _point(value.get("position", [0, 0, 0]), name, "estimator_frame's position")
    quat = value.get("orientation_xyzw", [0, 0, 0, 1])
    return from_position_quat_xyzw(
        position, _quaternion(quat, name, "estimator_frame's orientation_xyzw")
    )


def _quaternion(value: Any, name: str, what: str) -> Array:
    good = isinstance(value, list) and len(value) == 4 and all(_is_number(v) for v in value)
    if not good or abs(math.sqrt(sum(v * v for v in value)) - 1.0) > QUATERNION_TOLERANCE:
        raise _invalid(
            name,
            f"has {what} {reprlib.repr(value)}; give four numbers [x, y, z, w] of length 1 within "
            f"{QUATERNION_TOLERANCE:g}",
        )
    return np.array(value, dtype=float)


def _symmetry(value: Any, name: str) -> SymmetryGroup:
    """The group of a list of axes with an order, or of rotations."""
    entries = value if isinstance(value, list) else []
    if not 0 < len(entries) <= MOST_SYMMETRIES:
        raise _invalid(
            name,
            f"has symmetries {reprlib.repr(value)}; give a list of 1 to {MOST_SYMMETRIES} entries "
            "such as {axis: [0, 0, 1], order: 6} or {rotation_xyzw: [0, 0, 1, 0]}",
        )
    try:
        return SymmetryGroup([_turn(entry, name) for entry in entries])
    except ValueError as error:
        raise _invalid(name, f"has symmetries that no body has: {error}") from None


def _turn(entry: Any, name: str) -> Turn:
    keys = set(entry) if isinstance(entry, Mapping) else set()
    if keys - {"point"} == {"rotation_xyzw"}:
        quat = _quaternion(entry["rotation_xyzw"], name, "a symmetry's rotation_xyzw")
        sine = float(np.linalg.norm(quat[:3]))
        if sine < MIN_AXIS:
            raise _invalid(name, "has a symmetry that turns by nothing; leave it out")
        rotvec = 2.0 * math.atan2(sine, float(quat[3])) * quat[:3] / sine
        return Turn(rotvec, _center(entry, name))
    if keys - {"point"} != {"axis", "order"}:
        raise _invalid(
            name,
            f"has the symmetry {reprlib.repr(entry)}; give axis and order, or rotation_xyzw, and "
            "where it does not pass through the origin a point [x, y, z] in m",
        )
    axis, order = _point(entry["axis"], name, "a symmetry's axis"), entry["order"]
    length = float(np.linalg.norm(axis))
    if length < MIN_AXIS:
        raise _invalid(name, f"has the symmetry axis {axis.tolist()}; give a direction")
    if order == "any":
        return Turn(axis / length, _center(entry, name), any_angle=True)
    if isinstance(order, bool) or not isinstance(order, int) or not 2 <= order <= MOST_TURNS:
        raise _invalid(
            name,
            f"has a symmetry's order {reprlib.repr(order)}; give a whole number from 2 to "
            f"{MOST_TURNS}, or any",
        )
    return Turn(2.0 * math.pi / order * axis / length, _center(entry, name))


def _center(entry: Mapping[str, Any], name: str) -> Array:
    return _point(entry.get("point", [0, 0, 0]), name, "a symmetry's point")


def _point(value: Any, name: str, what: str = "center_of_mass") -> Array:
    numbers = value if isinstance(value, list) else []
    if len(numbers) != 3 or not all(_is_number(v) for v in numbers):
        raise _invalid(name, f"has {what} {reprlib.repr(value)}; give three numbers [x, y, z] in m")
    point = np.array(numbers, dtype=np.float64)
    if not (np.abs(point) <= MAX_COORDINATE_M).all():
        raise _invalid(
            name,
            f"has {what} {reprlib.repr(value)}; it is in metres, at most "
            f"{MAX_COORDINATE_M:g} from the origin",
        )
    return point


def _viewpoints(value: Any, name: str) -> Array:
    if not isinstance(value, list) or not 0 < len(value) <= MOST_VIEWPOINTS:
        raise _invalid(
            name,
            f"has viewpoints {reprlib.repr(value)}; give a list of 1 to {MOST_VIEWPOINTS} points "
            "[x, y, z] in m",
        )
    return np.stack([_point(point, name, "a viewpoint") for point in value])


def _number(value: Any, what: str, unit: str, high: float, name: str) -> float:
    if not _is_number(value) or not 0.0 < value <= high:
        limit = f"above 0 and at most {high:g} {unit}".rstrip()
        raise _invalid(name, f"has {what} {reprlib.repr(value)}; it must be {limit}")
    return float(value)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return math.isfinite(value) if isinstance(value, float) else abs(value) < 10**18


def _list(words: Any) -> str:
    return ", ".join(words)


def _invalid(name: str, what: str) -> MeshError:
    return MeshError(f"{name} {what}.", ErrorCode.MESH_SIDECAR_INVALID)
