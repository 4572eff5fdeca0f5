"""A hand as data: its URDF and a YAML file with what a URDF cannot say.

A further hand comes by adding ``models/<name>/<name>.yaml`` with its URDF and convex meshes; the
code knows no hand by name except the default.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.urdf import UrdfTree, read_urdf, with_mesh_uris

Array = NDArray[np.float64]

DEFAULT_HAND = "barrett_bh280"


@dataclass(frozen=True)
class Finger:
    """One finger: indices of its joints and links (-1: it has none).

    `spread_sign` is the sense of the spread about the palm's z axis, 0 without a spread joint.
    """

    name: str
    spread_joint: int
    inner_joint: int
    distal_joint: int
    knuckle_link: int
    inner_link: int
    distal_link: int
    spread_sign: int


@dataclass(frozen=True, eq=False)
class Drive:
    """Motors and gears; motors are ordered spread, then one per finger.

    Finger motors' angles are given as the inner joint's angle they give without breakaway.
    """

    motor_names: tuple[str, ...]
    motor_lower: Array  # [rad]
    motor_upper: Array  # [rad]
    motor_speed: Array  # [rad/s]
    distal_per_inner: float  # coupling before breakaway
    breakaway_torque: float  # [N m]
    tip_point: Array  # (3,) [m], where a fingertip presses, in the distal link's frame


@dataclass(frozen=True, eq=False)
class Eigengrasps:
    """A low-dimensional posture space: motors = origin + amplitudes @ directions."""

    origin: Array  # (n_motors,) [rad]
    directions: Array  # (n, n_motors)
    amplitude_limit: float


@dataclass(frozen=True, eq=False)
class DesiredContacts:
    """Points of the hand where contact is wanted, for a guided potential."""

    links: NDArray[np.int64]  # (n,)
    points: Array  # (n, 3) [m], link frame
    normals: Array  # (n, 3), out of the hand, link frame


@dataclass(frozen=True, eq=False)
class HandDescription(UrdfTree):
    """All that is known of a hand. Its arrays are shared and read-only.

    Attributes beside those of :class:`~gpis_grasp_planner.hand.urdf.UrdfTree`:

    name : str
    urdf_path : Path
    palm_link : str
        The root link; its frame is the palm frame P of ``docs/frames.md``.
    link_friction_group : tuple of str
        "palm" or "finger" per link.
    fingers : tuple of Finger
    drive : Drive
    eigengrasps : Eigengrasps
    desired_contacts : DesiredContacts
    """

    name: str
    urdf_path: Path
    palm_link: str
    link_friction_group: tuple[str, ...]
    fingers: tuple[Finger, ...]
    drive: Drive
    eigengrasps: Eigengrasps
    desired_contacts: DesiredContacts

    @property
    def n_joints(self) -> int:
        """Number of movable joints."""
        return len(self.joint_names)

    @property
    def n_links(self) -> int:
        """Number of links, the palm included."""
        return len(self.link_names)


def available_hands() -> tuple[str, ...]:
    """Names :func:`load_hand` knows."""
    return tuple(sorted(path.parent.name for path in _models().glob("*/*.yaml")))


@lru_cache(maxsize=8)
def load_hand(name: str = DEFAULT_HAND) -> HandDescription:
    """Load a hand by name; the same object every time. First call about 15 ms.

    Raises
    ------
    RequestError
        If there is no such hand or its files contradict each other.
    """
    if name not in available_hands():
        raise RequestError(f"Unknown hand '{name}'; known are {', '.join(available_hands())}.")
    folder = _models() / name
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    with (folder / f"{name}.yaml").open(encoding="utf-8") as file:
        data = yaml.load(file, Loader=loader)
    urdf_path = folder / data["urdf"]
    tree = read_urdf(urdf_path)
    if tree.link_names[0] != data["palm_link"]:
        raise RequestError(
            f"The root of '{urdf_path}' is '{tree.link_names[0]}', but the hand's YAML names "
            f"'{data['palm_link']}' as palm link; make them agree."
        )
    palm_like = set(data["palm_friction_links"])
    fingers = tuple(_finger(tree, entry) for entry in data["fingers"])
    hand = HandDescription(
        **{f.name: getattr(tree, f.name) for f in fields(UrdfTree)},
        name=name,
        urdf_path=urdf_path,
        palm_link=data["palm_link"],
        link_friction_group=tuple(
            "palm" if link in palm_like else "finger" for link in tree.link_names
        ),
        fingers=fingers,
        drive=_drive(data["drive"]),
        eigengrasps=Eigengrasps(
            origin=np.array(data["eigengrasps"]["origin"], dtype=float),
            directions=np.array(data["eigengrasps"]["directions"], dtype=float),
            amplitude_limit=float(data["eigengrasps"]["amplitude_limit"]),
        ),
        desired_contacts=_desired_contacts(data["desired_contacts"], fingers),
    )
    for part in (hand, hand.drive, hand.eigengrasps, hand.desired_contacts):
        _freeze(part)
    return hand


def urdf_text(hand: HandDescription, mesh_uri_prefix: str | None = None) -> str:
    """URDF text whose meshes are absolute URIs, for ``robot_description`` and RViz.

    Parameters
    ----------
    hand : HandDescription
    mesh_uri_prefix : str, optional
        What stands before ``/meshes/...``, such as ``package://name/path``; default is the
        ``file://`` URI of the URDF's folder.
    """
    prefix = hand.urdf_path.parent.as_uri() if mesh_uri_prefix is None else mesh_uri_prefix
    return with_mesh_uris(hand.urdf_path, prefix)


def _models() -> Path:
    return Path(__file__).resolve().parent / "models"


def _finger(tree: UrdfTree, entry: Mapping[str, Any]) -> Finger:
    joints = {
        key: -1 if entry[key] is None else tree.joint_names.index(entry[key])
        for key in ("spread_joint", "inner_joint", "distal_joint")
    }
    moved_by = {int(joint): link for link, joint in enumerate(tree.link_joint) if joint >= 0}
    inner_link = moved_by[joints["inner_joint"]]
    return Finger(
        name=entry["name"],
        **joints,
        knuckle_link=int(tree.link_parent[inner_link]),
        inner_link=inner_link,
        distal_link=moved_by[joints["distal_joint"]],
        spread_sign=int(entry["spread_sign"]),
    )


def _drive(data: Mapping[str, Any]) -> Drive:
    upper = np.radians(np.array(data["motor_upper_deg"], dtype=float))
    return Drive(
        motor_names=tuple(data["motor_names"]),
        motor_lower=np.zeros_like(upper),
        motor_upper=upper,
        motor_speed=upper / np.array(data["full_travel_s"], dtype=float),
        distal_per_inner=data["motor_to_inner"] / data["motor_to_distal"],
        breakaway_torque=float(data["breakaway_torque"]),
        tip_point=np.array(data["tip_point_mm"], dtype=float) / 1000.0,
    )


def _desired_contacts(data: Mapping[str, Any], fingers: tuple[Finger, ...]) -> DesiredContacts:
    wanted = [(0, entry) for entry in data["palm"]]
    for finger in fingers:
        wanted += [(finger.inner_link, entry) for entry in data["inner"]]
        wanted += [(finger.distal_link, entry) for entry in data["distal"]]
    normals = np.array([entry["normal"] for _, entry in wanted], dtype=float)
    return DesiredContacts(
        links=np.array([link for link, _ in wanted]),
        points=np.array([entry["point_mm"] for _, entry in wanted], dtype=float) / 1000.0,
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
    )


def _freeze(part: Any) -> None:
    for value in vars(part).values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
