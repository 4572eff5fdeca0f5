"""The default hand closes as it did: attempts that were written down before hands became data.

Written anew, where a change of the closing is meant, by running this file as a program.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.part import Friction
from gpis_grasp_planner.grasp.evaluator import Attempts
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.hand.description import load_hand
from gpis_grasp_planner.scene.compiled_evaluator import CompiledEvaluator
from gpis_grasp_planner.search.search_space import PalmSearchSpace

FILE = Path(__file__).with_name("barrett_attempts.json")
PARTS = ("mug", "flange")


def attempts(mesh_id: str) -> Attempts:
    """60 palms of the search space, moved along their axis until free."""
    part, hand = MeshCatalogue([default_catalogue_directory()]).load(mesh_id), load_hand()
    evaluator = CompiledEvaluator(hand, part, Friction(0.6, 0.4), SceneSettings(field_cells=40))
    rng = np.random.default_rng(11)
    space = PalmSearchSpace(part.mesh.bounds, 0.06)
    T, spread = space.poses(space.domain.sample(60, rng)), rng.uniform(0.0, 3.0, (60, 1))
    T[:, :3, 3] = 0.3 * T[:, :3, 3] - 0.08 * T[:, :3, 2]
    T, _ = evaluator.clear_palm(T, -T[:, :3, 2], spread, np.zeros(60))
    return evaluator.attempt(T, spread)


def facts(found: Attempts) -> dict[str, list]:
    return {
        "status": found.status.tolist(),
        "n_contacts": found.n_contacts.tolist(),
        "joints": np.round(found.joints, 9).tolist(),
        "palm": np.round(found.T_object_palm[:, :3, 3], 9).tolist(),
        "epsilon": np.round(found.epsilon, 9).tolist(),
    }


@pytest.mark.parametrize("mesh_id", PARTS)
def test_the_barrett_closes_as_it_was_written_down(mesh_id: str) -> None:
    expected, found = json.loads(FILE.read_text())[mesh_id], facts(attempts(mesh_id))
    assert found["status"] == expected["status"]
    assert found["n_contacts"] == expected["n_contacts"]
    for name in ("joints", "palm", "epsilon"):
        np.testing.assert_allclose(found[name], expected[name], atol=1e-6)
    assert sum(epsilon > 0.0 for epsilon in found["epsilon"]) > 5


if __name__ == "__main__":
    FILE.write_text(json.dumps({name: facts(attempts(name)) for name in PARTS}) + "\n")
