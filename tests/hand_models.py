"""What the tests of several hands share: closing on a part, and the scripts behind the models."""

from __future__ import annotations

import runpy
import shutil
import warnings
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.transforms import inverse, transform
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import HandDescription, load_hand
from gpis_grasp_planner.hand.link_shapes import read_link_mesh
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.verification.protocol import verify
from gpis_grasp_planner.verification.settings import VerificationSettings


def closed_on(hand: HandDescription, part: Part, center_palm: np.ndarray | list[float]) -> Grasp:
    """The grasp that the closing makes of a part whose frame is parallel to the palm's."""
    T = inverse(transform(np.eye(3), center_palm))
    closed = CompiledEvaluator(hand, part, Friction(0.6, 0.6), SceneSettings()).attempt(
        T[None], np.zeros((1, len(hand.preshape)))
    )
    return Grasp(
        T_object_palm=closed.T_object_palm[0],
        joints=closed.joints[0],
        pregrasp_joints=np.zeros(hand.n_joints),
        contacts=closed.contacts(0),
        quality=closed.quality(0),
        approach_direction=T[:3, 2],
        approach_distance=0.1,
    )


def box_link(name: str, size: tuple[float, ...], center: tuple[float, ...]) -> str:
    """URDF text of a link that is a box of edges `size` about `center` [m]."""
    at, edges = (" ".join(map(str, v)) for v in (center, size))
    return (
        f'<link name="{name}"><inertial><mass value="0.04"/></inertial><collision>'
        f'<origin xyz="{at}"/><geometry><box size="{edges}"/></geometry></collision></link>'
    )


def joint_about(
    name: str,
    parent: str,
    origin: str,
    ends: tuple[float, float],
    kind: str = "revolute",
    axis: str = "0 0 1",
) -> str:
    """URDF text of the joint ``<name>_joint`` that moves link `name` between two ends."""
    return (
        f'<joint name="{name}_joint" type="{kind}"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin {origin}/><axis xyz="{axis}"/>'
        f'<limit lower="{ends[0]}" upper="{ends[1]}" velocity="3" effort="4"/></joint>'
    )


def held_in_both_engines(part: Part, hand: HandDescription, grasps: Sequence[Grasp]) -> None:
    """That both engines try all grasps, and see some of them held."""
    for engine in ("mujoco", "bullet"):
        verdicts = verify(part, hand, grasps, VerificationSettings(engine=engine))
        held = [verdict.held for verdict in verdicts]
        print(engine, held)
        assert [verdict.engine for verdict in verdicts] == [engine] * len(grasps)
        assert any(held)


def assert_files_are_as_written(hand: HandDescription, directory: Path, n_files: int) -> None:
    """That the script beside a hand's model writes what is kept, into an empty directory."""
    folder = hand.urdf_path.parent
    runpy.run_path(str(folder / "build_model.py"))["write_model"](directory)
    written = sorted(p.relative_to(directory) for p in directory.rglob("*") if p.is_file())
    assert len(written) == n_files
    for name in written:
        if name.suffix == ".urdf":
            assert (directory / name).read_bytes() == (folder / name).read_bytes()
        else:  # hulls may list their faces in another order on another SciPy
            fresh, kept = read_link_mesh(directory / name), read_link_mesh(folder / name)
            np.testing.assert_allclose(fresh.vertices, kept.vertices, atol=1e-8)


def turned_copy(name: str, Q: np.ndarray, directory: Path) -> HandDescription:
    """A hand of ours whose root link is drawn in a frame that is turned by Q (3, 3).

    What stood at x in the root's frame stands at Q x; the palm's axis is then Q z.
    """
    folder = load_hand(name).yaml_path.parent
    shutil.copytree(folder, directory)
    data = yaml.safe_load((directory / f"{name}.yaml").read_text())
    robot = ET.parse(directory / data["urdf"])
    for element in _of_root(robot.getroot(), data["palm_link"]):
        origin = element.find("origin")
        if origin is None:
            origin = ET.SubElement(element, "origin")
        xyz = np.array(origin.get("xyz", "0 0 0").split(), dtype=float)
        rpy = np.array(origin.get("rpy", "0 0 0").split(), dtype=float)
        turned = Rotation.from_matrix(Q) * Rotation.from_euler("xyz", rpy)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # straight up or down: any of the many will do
            angles = turned.as_euler("xyz")
        for key, values in (("xyz", Q @ xyz), ("rpy", angles)):
            origin.set(key, " ".join(repr(float(value)) for value in values))
    robot.write(directory / data["urdf"])
    data["palm_axis"] = (Q @ [0.0, 0.0, 1.0]).tolist()
    for wanted in data["desired_contacts"]["palm"]:
        for key in ("point_mm", "normal"):
            wanted[key] = (Q @ wanted[key]).tolist()
    path = directory / f"{name}.yaml"
    path.write_text(yaml.safe_dump(data))
    return load_hand(str(path))


def _of_root(robot: ET.Element, root: str) -> list[ET.Element]:
    """What a URDF places in its root link's frame."""
    [link] = [link for link in robot.findall("link") if link.get("name") == root]
    shapes = [*link.findall("visual"), *link.findall("collision")]
    return [*shapes, *(j for j in robot.findall("joint") if j.find("parent").get("link") == root)]
