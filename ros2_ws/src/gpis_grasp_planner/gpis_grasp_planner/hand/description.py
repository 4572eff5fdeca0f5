"""A hand as data: its URDF and a YAML file with what a URDF cannot say.

A further hand comes by adding ``models/<name>/<name>.yaml`` with its URDF, or by such a file
anywhere (docs/hands.md); the code knows no hand by name except the default.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.hand.drive_train import Drive, read_drive, rounded_limits
from gpis_grasp_planner.hand.finger import Finger, read_finger
from gpis_grasp_planner.hand.mimic import check_mimic
from gpis_grasp_planner.hand.open_hand import JointCount, counted_from_open, read_joint_count
from gpis_grasp_planner.hand.pads import pad_of_palm, pads_of_link
from gpis_grasp_planner.hand.palm_turn import palm_turn
from gpis_grasp_planner.hand.preshape import SLIDING_LEVER_M, Preshape, read_preshape
from gpis_grasp_planner.hand.settings import DEFAULT_HAND
from gpis_grasp_planner.hand.structure import check_joints, check_structure
from gpis_grasp_planner.hand.urdf import UrdfTree, collision_meshes, read_urdf, with_mesh_uris

Array = NDArray[np.float64]


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
        By which :func:`load_hand` finds it: the model's, or the path of its YAML file.
    yaml_path, urdf_path : Path
    palm_link : str
        The root link; its frame, turned, is the palm frame P of ``docs/frames.md``.
    palm_turn : (3, 3) array
        Turns directions in the URDF's root link to the palm frame, whose z is out of the palm.
    joint_count : JointCount
        How the URDF counts the joints, and with it messages and documents (`hand.open_hand`).
    joint_back : (J,) array [rad or m]
        How far a joint that closes could go back beyond 0, where the open hand is; 0 or less. That
        part of its range is not used: `joint_lower` is 0.
    link_friction_group : tuple of str
        "palm" or "finger" per link.
    preshape : Preshape
    fingers : tuple of Finger
    drive : Drive
    eigengrasps : Eigengrasps
    desired_contacts : DesiredContacts
    contact_patches : bool
        Whether the fingers' links have flat pads, that touch with a patch (`scene.touch`).
    digest : str
        SHA-256 (hex) of the files as they were when the hand was read.
    """

    name: str
    yaml_path: Path
    urdf_path: Path
    palm_link: str
    palm_turn: Array
    joint_count: JointCount
    joint_back: Array
    link_friction_group: tuple[str, ...]
    preshape: Preshape
    fingers: tuple[Finger, ...]
    drive: Drive
    eigengrasps: Eigengrasps
    desired_contacts: DesiredContacts
    contact_patches: bool
    digest: str

    @property
    def identity(self) -> str:
        """The name; of a hand from a file of one's own with a hash, since the file may change."""
        if _models() in self.yaml_path.parents:
            return self.name
        return f"{self.name}#{self.digest[:16]}"

    def of_fingers(self, joints: Array) -> Array:
        """What the joints that closing moves have of (..., J) values, (..., F, D).

        D is the largest number of links of a finger. One of fewer has its own at the end, and 0
        before them: it is like one whose first joints cannot move.
        """
        values = np.zeros((*joints.shape[:-1], len(self.fingers), self.drive.n_links))
        for index, finger in enumerate(self.fingers):
            values[..., index, -len(finger.joints) :] = joints[..., list(finger.joints)]
        return values

    @property
    def first_joint(self) -> NDArray[np.int64]:
        """Where each finger's own joints begin among the D of `of_fingers`, (F,)."""
        return np.array([self.drive.n_links - len(finger.joints) for finger in self.fingers])

    @property
    def motor_lower(self) -> Array:
        """Lower ends of all motors, (S + F,): those of the pre-shape, then one for each finger."""
        return np.concatenate([self.preshape.lower, self.drive.motor_lower])

    @property
    def motor_upper(self) -> Array:
        """Upper ends of all motors, (S + F,)."""
        return np.concatenate([self.preshape.upper, self.drive.motor_upper])

    @property
    def closing_unit(self) -> Array:
        """What counts as 1 rad of a finger's closing, (F,) [rad or m].

        Steps and tolerances of the closing are set for fingers that turn. One that slides has them
        times a lever of 50 mm, at which 1 rad moves a fingertip as far.
        """
        slides = self.joint_slides[[finger.inner_joint for finger in self.fingers]]
        return np.where(slides, SLIDING_LEVER_M, 1.0)

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
    """Load a hand by name, or by its YAML file; the same object every time. First call about 15 ms.

    Raises
    ------
    RequestError
        If there is no such hand or its files contradict each other.
    MeshError
        If a collision mesh is missing or damaged.
    """
    if name.endswith((".yaml", ".yml")):
        path = Path(name).resolve()
        name = str(path)
    elif name in available_hands():
        path = _models() / name / f"{name}.yaml"
    else:
        raise RequestError(
            f"Unknown hand '{name}'; known are {', '.join(available_hands())}, or give a hand's "
            "YAML file, which ends in .yaml."
        )
    data = _read_yaml(path)
    try:
        return _described(name, path, data)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        missing = f"'{error.args[0]}' is missing" if isinstance(error, KeyError) else str(error)
        raise RequestError(
            f"'{path}' does not describe a hand: {missing}. Compare it with "
            f"'{_models() / DEFAULT_HAND / DEFAULT_HAND}.yaml' and docs/hands.md."
        ) from error


def _read_yaml(path: Path) -> dict[str, Any]:
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        with path.open(encoding="utf-8") as file:
            data = yaml.load(file, Loader=loader)
    except OSError as error:
        raise RequestError(
            f"Cannot read the hand '{path}': {error.strerror}. Give the path of its YAML file, or "
            f"one of {', '.join(available_hands())}."
        ) from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise RequestError(f"The hand '{path}' is no YAML file: {error}. Correct it.") from error
    if not isinstance(data, dict):
        raise RequestError(f"'{path}' holds no names and values; see docs/hands.md.")
    return data


def _described(name: str, path: Path, data: Mapping[str, Any]) -> HandDescription:
    urdf_path = path.parent / data["urdf"]
    turn = palm_turn(data.get("palm_axis", (0.0, 0.0, 1.0)))
    tree = read_urdf(urdf_path, turn, bool(data.get("collision_hulls", False)))
    if tree.link_names[0] != data["palm_link"]:
        raise RequestError(
            f"The root of '{urdf_path}' is '{tree.link_names[0]}', but the hand's YAML names "
            f"'{data['palm_link']}' as palm link; make them agree."
        )
    palm_like = set(data.get("palm_friction_links", [data["palm_link"]]))
    if unknown := sorted(palm_like - set(tree.link_names)):
        raise RequestError(
            f"'palm_friction_links' of '{path}' names {unknown}, which the URDF does not have; it "
            f"has {', '.join(tree.link_names)}."
        )
    count = read_joint_count(tree, data["fingers"])
    tree = counted_from_open(tree, count)
    fingers = tuple(read_finger(tree, entry, data["drive"]) for entry in data["fingers"])
    closing = [joint for finger in fingers for joint in finger.joints]
    preshape = read_preshape(data.get("preshape", ()), tree.joint_names, tree.joint_slides, closing)
    drive = read_drive(data["drive"], [finger.closing_ratio for finger in fingers])
    lower = tree.joint_lower.copy()
    begins = [j for j in closing if lower[j] < 0.0 < tree.joint_upper[j]]
    lower[begins] = 0.0
    upper = tree.joint_upper.copy()
    for finger, motor in zip(fingers, drive.motor_upper, strict=False):
        own = list(finger.joints)
        upper[own] = rounded_limits(finger.closing_ratio, upper[own], float(motor))
    ends = {"joint_lower": lower, "joint_upper": upper}
    hand = HandDescription(
        **{f.name: getattr(tree, f.name) for f in fields(UrdfTree)} | ends,
        joint_count=count,
        joint_back=tree.joint_lower - lower,
        name=name,
        yaml_path=path,
        urdf_path=urdf_path,
        palm_link=data["palm_link"],
        palm_turn=turn,
        link_friction_group=tuple(
            "palm" if link in palm_like else "finger" for link in tree.link_names
        ),
        preshape=preshape,
        fingers=fingers,
        drive=drive,
        eigengrasps=_eigengrasps(data.get("eigengrasps"), preshape, drive),
        desired_contacts=_desired_contacts(data, tree, fingers, turn),
        contact_patches=bool(data.get("contact_patches", False)),
        digest=_digest(path, urdf_path, *collision_meshes(urdf_path)),
    )
    check_joints(hand)
    check_mimic(tree, hand.preshape, fingers, hand.drive)
    check_structure(hand)
    parts = (hand, hand.preshape, *fingers, hand.drive, hand.eigengrasps, hand.desired_contacts)
    for part in (*parts, hand.joint_count):
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
    return with_mesh_uris(hand.urdf_path, prefix, hand.palm_turn)


def _digest(*files: Path) -> str:
    """Of what a hand is made of; later edits of the files do not belong to it."""
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _models() -> Path:
    return Path(__file__).resolve().parent / "models"


def _eigengrasps(data: Mapping[str, Any] | None, preshape: Preshape, drive: Drive) -> Eigengrasps:
    """The posture space of the file; without one every motor by itself, about the middle."""
    if data is not None:
        return Eigengrasps(
            origin=np.array(data["origin"], dtype=float),
            directions=np.array(data["directions"], dtype=float),
            amplitude_limit=float(data["amplitude_limit"]),
        )
    lower = np.concatenate([preshape.lower, drive.motor_lower])
    half = 0.5 * (np.concatenate([preshape.upper, drive.motor_upper]) - lower)
    return Eigengrasps(lower + half, np.diag(half), 1.0)


def _desired_contacts(
    data: Mapping[str, Any], tree: UrdfTree, fingers: tuple[Finger, ...], turn: Array
) -> DesiredContacts:
    """Those that the file gives, for all fingers or for one; else by the shapes (`hand.pads`)."""
    general = data.get("desired_contacts", {})
    if "palm" in general:
        of_palm = [(p @ turn.T, n @ turn.T) for p, n in _places(general["palm"])]
    else:
        of_palm = pad_of_palm(tree.link_collision[0])
    wanted = [(0, *place) for place in of_palm]
    for finger, own in zip(fingers, data["fingers"], strict=True):
        of_links = own.get("desired_contacts", general.get("links"))
        if of_links is None:
            found = [
                pads_of_link(tree.link_collision[i], tree.joint_axis[i], tree.joint_slides[j])
                for i, j in zip(finger.links, finger.joints, strict=True)
            ]
        else:
            found = [_places(entries) for entries in of_links]
        for link, places in zip(finger.links, found, strict=True):
            wanted += [(link, *place) for place in places]
    normals = np.array([normal for _, _, normal in wanted]).reshape(-1, 3)
    return DesiredContacts(
        links=np.array([link for link, _, _ in wanted], dtype=np.int64),
        points=np.array([point for _, point, _ in wanted]).reshape(-1, 3),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
    )


def _places(entries: Sequence[Mapping[str, Any]]) -> list[tuple[Array, Array]]:
    return [
        (
            np.array(entry["point_mm"], dtype=float) / 1000.0,
            np.array(entry["normal"], dtype=float),
        )
        for entry in entries
    ]


def _freeze(part: Any) -> None:
    for value in vars(part).values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
