"""An arm as data: a URDF for what turns, one YAML for where it stands and how it holds the hand."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from gpis_grasp_planner.arm.urdf import ArmChain, read_chain
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.geometry.transforms import from_position_quat_xyzw

Array = NDArray[np.float64]

_KEYS = {"name", "arm", "urdf", "flange_link", "redundant_joint", "may_touch", "base", "flange"}


@dataclass(frozen=True, eq=False)
class ArmDescription:
    """An arm with its place in the world and the hand's place on its flange.

    Attributes
    ----------
    name : str
        As it was asked for: a name of :func:`available_arms`, or a YAML file.
    chain : ArmChain
        Joints and bodies.
    T_arm_base : (4, 4) array
        "Arm" is the frame that `surroundings.place.Place.T_world_arm` places.
    T_flange_palm : (4, 4) array
    redundant_joint : int or None
        The joint of a seven-axis arm whose angle is chosen before the others follow.
    may_touch : frozenset of pairs of int
        Links (1 to n, 0 the base) whose bodies are not held against each other, smaller first.
        Neighbours never are.
    identity : str
        SHA-256 (hex) over the content of its files.
    """

    name: str
    chain: ArmChain
    T_arm_base: Array
    T_flange_palm: Array
    redundant_joint: int | None
    may_touch: frozenset[tuple[int, int]]
    identity: str

    @property
    def n_joints(self) -> int:
        """Number of joints."""
        return len(self.chain.joint_names)


def available_arms() -> tuple[str, ...]:
    """Names of the arms that come with the package."""
    return tuple(sorted(p.parent.name for p in _models().glob("*/*.yaml")))


def load_arm(name: str) -> ArmDescription:
    """Load an arm by name, or by its YAML file.

    Raises
    ------
    RequestError
        If there is no such arm, or its files contradict each other.
    """
    if name.endswith((".yaml", ".yml")):
        path = Path(name).resolve()
        name = str(path)
    elif name in available_arms():
        path = _models() / name / f"{name}.yaml"
    else:
        raise RequestError(
            f"Unknown arm '{name}'; known are {', '.join(available_arms())}, or give an arm's "
            "YAML file, which ends in .yaml."
        )
    return _loaded(name, path, path.stat().st_mtime_ns if path.is_file() else 0)


@lru_cache(maxsize=8)
def _loaded(name: str, path: Path, _changed_ns: int) -> ArmDescription:
    data, files = _layers(path)
    try:
        urdf = data["urdf"]
        chain = read_chain(urdf, data["flange_link"])
        redundant = data.get("redundant_joint")
        digest = hashlib.sha256()
        for file in (*files, urdf):
            digest.update(file.read_bytes())
        return ArmDescription(
            name=name,
            chain=chain,
            T_arm_base=_pose(data.get("base")),
            T_flange_palm=_pose(data.get("flange")),
            redundant_joint=None if redundant is None else chain.joint_names.index(redundant),
            may_touch=frozenset(
                _pair(chain.link_names.index(a), chain.link_names.index(b))
                for a, b in data.get("may_touch", ())
            ),
            identity=digest.hexdigest(),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        missing = f"'{error.args[0]}' is missing" if isinstance(error, KeyError) else str(error)
        raise RequestError(
            f"'{path}' does not describe an arm: {missing}. See docs/arm.md for the form."
        ) from error


def _layers(path: Path) -> tuple[dict[str, Any], tuple[Path, ...]]:
    """What a file says, over what the arm says that it names; and the files that were read."""
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise RequestError(f"Cannot read the arm '{path}': {error}.") from error
    if not isinstance(data, Mapping):
        raise RequestError(f"'{path}' holds no names and values; see docs/arm.md.")
    if unknown := sorted(set(map(str, data)) - _KEYS):
        raise RequestError(
            f"'{path}' has unknown fields {', '.join(unknown)}; known are "
            f"{', '.join(sorted(_KEYS))}."
        )
    given = dict(data)
    if "urdf" in given:
        given["urdf"] = path.parent / given["urdf"]
    if "arm" not in given:
        return given, (path,)
    base = given.pop("arm")
    if base not in available_arms():
        raise RequestError(
            f"'{path}' names the arm '{base}'; known are {', '.join(available_arms())}. Another "
            "arm is given by its own 'urdf' and 'flange_link'."
        )
    below, files = _layers(_models() / base / f"{base}.yaml")
    return {**below, **given}, (path, *files)


def _pose(data: Mapping[str, Any] | None) -> Array:
    """Pose (4, 4) of ``{position: [3], quat_xyzw: [4]}``."""
    data = data or {}
    if unknown := sorted(set(data) - {"position", "quat_xyzw"}):
        raise ValueError(f"a pose has no field {', '.join(unknown)}")
    position = np.array(data.get("position", (0.0, 0.0, 0.0)), dtype=float)
    quat = np.array(data.get("quat_xyzw", (0.0, 0.0, 0.0, 1.0)), dtype=float)
    if position.shape != (3,) or quat.shape != (4,) or not np.isfinite([*position, *quat]).all():
        raise ValueError("a pose has 3 numbers of 'position' and 4 of 'quat_xyzw'")
    if abs(np.linalg.norm(quat) - 1.0) > 1e-3:
        raise ValueError(f"a quat_xyzw has the length {np.linalg.norm(quat):g}, not 1")
    return from_position_quat_xyzw(position, quat)


def _pair(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _models() -> Path:
    return Path(__file__).parent / "models"
