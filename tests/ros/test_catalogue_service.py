"""The order of a batch."""

from __future__ import annotations

from typing import Any

from gpis_grasp_msgs.msg import Grasp, GraspVerification, PartGrasps
from gpis_grasp_planner.ros.catalogue_service import graspability


def part(name: str, *, held: bool = False, success: bool = True, **fields: Any) -> PartGrasps:
    grasp = Grasp(verification=GraspVerification(attempted=held, held=held), **fields)
    return PartGrasps(mesh_id=name, success=success, grasps=[grasp])


def test_the_most_graspable_comes_first() -> None:
    in_order = [
        part("held, likely", held=True, hold_probability=0.9, epsilon=0.1),
        part("held, less likely", held=True, hold_probability=0.2, epsilon=0.3),
        part("held", held=True, epsilon=0.2),
        part("good", epsilon=0.3),
        part("poor", epsilon=0.1),
        PartGrasps(mesh_id="nothing"),
    ]
    mixed = [in_order[k] for k in (3, 5, 0, 4, 2, 1)]
    found = sorted(mixed, key=graspability, reverse=True)
    assert [p.mesh_id for p in found] == [p.mesh_id for p in in_order]
