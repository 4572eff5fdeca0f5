"""What is made once per mesh: once, side by side, and from the disk as if made anew."""

from __future__ import annotations

import threading
from dataclasses import fields, replace

import numba
import numpy as np
import pytest

from gpis_grasp_planner.disk_cache import CacheSettings
from gpis_grasp_planner.errors import ErrorCode, MeshError, PlanningError
from gpis_grasp_planner.geometry.distance_field import DistanceField
from gpis_grasp_planner.geometry.triangle_tree import TriangleTree
from gpis_grasp_planner.grasp.scene_settings import SceneSettings
from gpis_grasp_planner.plan import preparation as module
from gpis_grasp_planner.plan.preparation import Preparation
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.surface.implicit_surface import fit_part
from gpis_grasp_planner.surface.settings import SurfaceSettings

QUICK = PlannerSettings(
    scene=SceneSettings(field_cells=32), surface=SurfaceSettings(n_samples=1500)
)


@pytest.fixture
def kept(tmp_path):
    return replace(QUICK, cache=CacheSettings(directory=str(tmp_path / "objects")))


def assert_alike(one, other):
    """Equal, and of one type for compiled code, which would be compiled again for another."""
    np.testing.assert_array_equal(one, other)
    assert numba.typeof(np.asarray(one)) == numba.typeof(np.asarray(other))


def assert_same(one, other):
    for part in ("field", "tree"):
        for f in fields(getattr(one, part)):
            assert_alike(getattr(getattr(one, part), f.name), getattr(getattr(other, part), f.name))
    first, second = one.atlas.surface.as_arrays(), other.atlas.surface.as_arrays()
    assert list(first) == list(second)
    for name, array in first.items():
        assert_alike(array, second[name])
    assert_alike(one.atlas.points, other.atlas.points)


def test_a_part_is_prepared_once(sphere):
    preparation = Preparation(QUICK)
    assert preparation.of(sphere) is preparation.of(sphere)


def test_side_by_side_is_as_one_after_the_other(sphere):
    prepared = Preparation(QUICK).of(sphere)
    field, tree = DistanceField.of(sphere.mesh, cells=32), TriangleTree.of(sphere.mesh)
    surface = fit_part(sphere.mesh, QUICK.surface)
    np.testing.assert_array_equal(prepared.field.values, field.values)
    np.testing.assert_array_equal(prepared.tree.child, tree.child)
    for name, array in surface.as_arrays().items():
        np.testing.assert_array_equal(prepared.atlas.surface.as_arrays()[name], array)


def test_the_disk_gives_what_was_made(sphere, kept, monkeypatch, rng):
    made = Preparation(kept).of(sphere)
    monkeypatch.setattr(module, "fit_part", None)
    read = Preparation(kept).of(sphere)
    assert_same(made, read)
    points = 0.1 * rng.normal(size=(200, 3))
    for one, other in zip(
        made.atlas.surface.value_and_gradient(points),
        read.atlas.surface.value_and_gradient(points),
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(made.tree.nearest(points)[0], read.tree.nearest(points)[0])
    np.testing.assert_array_equal(made.field.value(points), read.field.value(points))


@pytest.mark.parametrize(
    "change",
    [
        {"scene": SceneSettings(field_cells=24)},
        {"surface": SurfaceSettings(n_samples=1000)},
    ],
)
def test_other_settings_are_another_entry(sphere, kept, change):
    preparation = Preparation(kept)
    preparation.of(sphere)
    other = Preparation(replace(kept, **change))
    other.of(sphere)
    assert len(preparation.disk.entries()) == 2


def test_another_version_of_the_code_is_another_entry(sphere, kept, monkeypatch):
    preparation = Preparation(kept)
    preparation.of(sphere)
    monkeypatch.setattr(module, "code_version", lambda *_: "later")
    Preparation(kept).of(sphere)
    assert len(preparation.disk.entries()) == 2


def test_a_damaged_entry_is_made_anew(sphere, kept):
    preparation = Preparation(kept)
    made = preparation.of(sphere)
    [path] = preparation.disk.folder.iterdir()
    path.write_bytes(path.read_bytes()[:-1])
    assert_same(made, Preparation(kept).of(sphere))
    assert len(preparation.disk.entries()) == 1


def test_the_share_done_only_grows(sphere, monkeypatch):
    monkeypatch.setattr(module, "_LOOK_S", 0.0)
    shares = []
    Preparation(QUICK).of(sphere, on_share=shares.append)
    assert len(shares) > 3
    assert np.all(np.diff(shares) >= 0.0)
    assert shares[0] >= 0.0
    assert shares[-1] <= 1.0


def test_it_ends_when_asked_and_leaves_nothing_running(catalogue, kept):
    mug, preparation = catalogue.load("mug"), Preparation(kept)  # takes twenty looks
    with pytest.raises(PlanningError) as caught:
        preparation.of(mug, should_stop=lambda: True)
    assert caught.value.code is ErrorCode.CANCELLED
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and thread.daemon:
            thread.join(10.0)
            assert not thread.is_alive()
    assert preparation.disk.entries() == []
    assert preparation.of(mug) is preparation.of(mug)


def test_a_step_that_never_ends_does_not_keep_the_caller(sphere, monkeypatch):
    stuck = threading.Event()
    monkeypatch.setattr(module, "fit_part", lambda *_, **__: stuck.wait())
    asked = []
    with pytest.raises(PlanningError):
        Preparation(QUICK).of(sphere, should_stop=lambda: len(asked) > 3 or asked.append(1))
    stuck.set()


def test_the_error_of_a_part_is_the_callers(sphere, monkeypatch):
    def refuse(*_, **__):
        raise MeshError("no surface", ErrorCode.MESH_DEGENERATE)

    monkeypatch.setattr(module, "fit_part", refuse)
    with pytest.raises(MeshError, match="no surface"):
        Preparation(QUICK).of(sphere)


def test_what_is_late_goes_on_for_the_next_request(sphere, monkeypatch):
    may_end = threading.Event()

    def slow_fit(*arguments, **options):
        may_end.wait(30.0)
        return fit_part(*arguments, **options)

    calls = []
    monkeypatch.setattr(module, "fit_part", lambda *a, **o: calls.append(1) or slow_fit(*a, **o))
    preparation = Preparation(QUICK)
    with pytest.raises(PlanningError) as caught:
        preparation.of(sphere, late=lambda: True)
    assert caught.value.code is ErrorCode.DEADLINE_EXCEEDED
    assert "Ask again with more time" in caught.value.message
    may_end.set()
    assert preparation.of(sphere).atlas is not None
    assert calls == [1]


def test_who_is_cancelled_does_not_end_the_work_of_another(sphere, monkeypatch):
    may_end, waiting = threading.Event(), threading.Event()

    def slow_fit(*arguments, **options):
        waiting.set()
        may_end.wait(30.0)
        return fit_part(*arguments, **options)

    monkeypatch.setattr(module, "fit_part", slow_fit)
    preparation = Preparation(QUICK)
    results = []
    other = threading.Thread(target=lambda: results.append(preparation.of(sphere)))
    other.start()
    assert waiting.wait(30.0)
    with pytest.raises(PlanningError) as caught:
        preparation.of(sphere, should_stop=lambda: True)
    assert caught.value.code is ErrorCode.CANCELLED
    may_end.set()
    other.join(60.0)
    assert len(results) == 1
