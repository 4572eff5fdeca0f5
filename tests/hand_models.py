"""What the tests of several hands share: closing on a part, and the scripts behind the models."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np

from gpis_grasp_planner.geometry.part import Friction, Part
from gpis_grasp_planner.geometry.transforms import inverse, transform
from gpis_grasp_planner.grasp.grasp import Grasp
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import HandDescription
from gpis_grasp_planner.hand.link_mesh import read_stl
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator


def closed_on(hand: HandDescription, part: Part, center_palm: np.ndarray | list[float]) -> Grasp:
    """The grasp that the closing makes of a part whose frame is parallel to the palm's."""
    T = inverse(transform(np.eye(3), center_palm))
    closed = CompiledEvaluator(hand, part, Friction(0.6, 0.6), SceneSettings()).attempt(
        T[None], np.zeros(1)
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
            fresh, kept = read_stl(directory / name), read_stl(folder / name)
            np.testing.assert_allclose(fresh.vertices, kept.vertices, atol=1e-8)
