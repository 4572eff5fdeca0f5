"""One small plan for all tests of the store."""

from __future__ import annotations

import pytest
import trimesh
from planning_fixtures import make_part
from store_writers import small_plan

from gpis_grasp_planner.store.grasp_store import GraspStore


@pytest.fixture(scope="session")
def box():
    return make_part("box", trimesh.creation.box((0.05, 0.06, 0.09)))


@pytest.fixture(scope="session")
def plan(box):
    result = small_plan(box)
    assert result.grasps
    assert len(result.reserve)
    return result


@pytest.fixture(autouse=True)
def _nothing_said_yet(monkeypatch):
    monkeypatch.setattr(GraspStore, "_said", set())


@pytest.fixture
def store(tmp_path):
    return GraspStore(tmp_path / "folder" / "grasps.sqlite")
