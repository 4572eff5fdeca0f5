from __future__ import annotations

import numpy as np
import pytest

from gpis_grasp_benchmark.bullet_objects import (
    HOUSEHOLD_SET,
    LONGEST_SIDE_M,
    RANDOM_SET,
    bullet_objects,
    scaled,
)
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.plan.warm_up import box_part
from gpis_grasp_planner.scene.bullet_world import bullet_data_directory


def test_the_data_package_is_there() -> None:
    assert len(list(bullet_data_directory().glob("random_urdfs/*/*.obj"))) == 1000


def test_random_parts_are_spread_evenly_and_seeded() -> None:
    parts, refused = bullet_objects(8, seed=3)
    numbers = [int(part.mesh_id.removeprefix("bullet-random-")) for part in parts[RANDOM_SET]]
    assert len(numbers) == 8
    assert set(np.diff(numbers)) <= {125, 124, 126}
    longest = [part.mesh.extent.max() for part in parts[RANDOM_SET] + parts[HOUSEHOLD_SET]]
    assert LONGEST_SIDE_M[0] <= min(longest) < max(longest) <= LONGEST_SIDE_M[1]
    assert len(set(longest)) == len(longest)
    again, _ = bullet_objects(8, seed=3)
    assert [p.mesh.content_hash for p in again[RANDOM_SET]] == [
        p.mesh.content_hash for p in parts[RANDOM_SET]
    ]
    other, _ = bullet_objects(8, seed=4)
    assert other[RANDOM_SET][0].mesh_id != parts[RANDOM_SET][0].mesh_id
    # Nothing of the household objects is lost: accepted, or refused with a reason.
    names = {part.mesh_id for part in parts[HOUSEHOLD_SET]} | {r.object_id for r in refused}
    assert {"bullet-mug", "bullet-duck", "bullet-teddy", "bullet-lego"} <= names
    # The brick has faces without area: usable all the same, and said.
    [lego] = [part for part in parts[HOUSEHOLD_SET] if part.mesh_id == "bullet-lego"]
    assert any("area" in note for note in lego.notes)


def test_a_scaled_part_is_the_same_part_larger() -> None:
    box = box_part()
    part = scaled(box, "large", np.array([1.0, 1.0, 2.0]), 0.28)
    assert part.mesh.extent == pytest.approx([0.08, 0.1, 0.28])
    assert part.volume == pytest.approx(0.08 * 0.1 * 0.28)
    assert part.mass == pytest.approx(1000.0 * part.volume)
    assert part.center_of_mass == pytest.approx(np.zeros(3))
    assert "280.0 mm" in part.notes[-1]


def test_more_than_there_are() -> None:
    with pytest.raises(RequestError, match="it ships 1000"):
        bullet_objects(1001)
