"""The cache is bounded, and whatever happens to it costs time and nothing else."""

from __future__ import annotations

import errno
import logging
import multiprocessing
import os
from pathlib import Path

import numpy as np
import pytest

from gpis_grasp_planner import disk_cache
from gpis_grasp_planner.disk_cache import CacheSettings, DiskCache, code_version


@pytest.fixture(autouse=True)
def _nothing_said_yet(monkeypatch):
    monkeypatch.setattr(DiskCache, "_said", set())


@pytest.fixture
def cache(tmp_path):
    return DiskCache(tmp_path / "objects")


def block(n_bytes):
    return {"a": np.arange(n_bytes, dtype=np.uint8)}


def test_what_is_put_comes_back(cache, rng):
    arrays = {"a": rng.normal(size=(5, 3)), "n": 7}
    cache.put("object", "mug", arrays)
    got = DiskCache(cache.folder).get("object", "mug")
    np.testing.assert_array_equal(got["a"], arrays["a"])
    assert got["n"] == 7
    assert cache.get("object", "flask") is None
    assert cache.get("cover", "mug") is None


def test_what_was_not_used_for_longest_goes(cache):
    cache.most_bytes = 3500
    for age, key in enumerate("abc"):
        cache.put("object", key, block(700))
        os.utime(cache._path("object", key), (1000.0 + age, 1000.0 + age))
    assert cache.get("object", "a") is not None  # now the last used
    cache.put("object", "d", block(900))
    assert cache.get("object", "b") is None
    assert all(cache.get("object", key) is not None for key in "acd")
    assert sum(entry.n_bytes for entry in cache.entries()) <= cache.most_bytes


def test_what_alone_is_too_large_is_not_kept(cache):
    cache.most_bytes = 1000
    cache.put("object", "small", block(500))
    cache.put("object", "large", block(1000))
    assert cache.get("object", "small") is not None
    assert cache.get("object", "large") is None


@pytest.mark.parametrize("damage", ["truncated", "flipped", "empty", "other"])
def test_a_damaged_file_is_set_aside_and_made_anew(cache, caplog, damage):
    cache.put("object", "mug", block(5000))
    path = cache._path("object", "mug")
    content = bytearray(path.read_bytes())
    content[3000] ^= 1
    path.write_bytes(
        {"truncated": content[:2000], "flipped": content, "empty": b"", "other": b"x" * 9}[damage]
    )
    assert cache.get("object", "mug") is None
    assert cache.get("object", "mug") is None
    assert len(caplog.records) == 1
    assert "set aside" in caplog.text
    assert not path.exists()
    assert path.with_suffix(".damaged").exists()
    cache.put("object", "mug", block(5000))
    np.testing.assert_array_equal(cache.get("object", "mug")["a"], block(5000)["a"])


def test_a_crash_in_the_middle_of_a_write_leaves_what_was_there(cache, monkeypatch):
    cache.put("object", "mug", block(100))

    def crash(self, content):
        with self.open("wb") as file:
            file.write(content[:50])
        os._exit(3)

    def write():
        monkeypatch.setattr(Path, "write_bytes", crash)
        cache.put("object", "mug", block(200))

    child = multiprocessing.get_context("fork").Process(target=write)
    child.start()
    child.join()
    assert child.exitcode == 3
    assert len(cache.get("object", "mug")["a"]) == 100
    [left_over] = [p for p in cache.folder.iterdir() if p.suffix != ".arrays"]
    os.utime(left_over, (0.0, 0.0))
    cache.put("object", "flask", block(100))
    assert not left_over.exists()


def _work(folder, number, errors):
    cache = DiskCache(Path(folder), 20_000)
    rng = np.random.default_rng(number)
    for _ in range(150):
        key = int(rng.integers(8))
        if rng.random() < 0.5:
            cache.put("object", str(key), {"a": np.full(500, key)})
        got = cache.get("object", str(key))
        if got is not None and (got["a"] != key).any():
            errors.put(key)
        if rng.random() < 0.05:
            cache.clear()
    errors.put(None)


def test_two_processes_at_a_time_see_whole_files_only(cache):
    context = multiprocessing.get_context("fork")
    errors = context.SimpleQueue()
    children = [
        context.Process(target=_work, args=(str(cache.folder), number, errors))
        for number in range(2)
    ]
    for child in children:
        child.start()
    assert [errors.get(), errors.get()] == [None, None]
    for child in children:
        child.join()
        assert child.exitcode == 0
    assert not [p for p in cache.folder.iterdir() if p.suffix == ".damaged"]


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES])
def test_a_write_that_fails_is_said_once(cache, caplog, monkeypatch, number):
    cache.put("object", "mug", block(10))

    def fail(self, content):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(Path, "write_bytes", fail)
    with caplog.at_level(logging.WARNING):
        cache.put("object", "flask", block(10))
        cache.put("object", "phone", block(10))
    assert [os.strerror(number) in record.message for record in caplog.records] == [True]
    assert cache.get("object", "mug") is not None
    assert cache.get("object", "flask") is None


def test_a_folder_that_cannot_be_is_said_once(tmp_path, caplog):
    (tmp_path / "file").touch()
    cache = DiskCache(tmp_path / "file" / "objects")
    cache.put("object", "mug", block(10))
    cache.put("object", "mug", block(10))
    assert cache.get("object", "mug") is None
    assert cache.entries() == []
    assert cache.clear() == 0
    assert 1 <= len(caplog.records) <= 2  # one of writing, one of reading


def test_clearing_touches_nobody_elses_files(cache):
    cache.put("object", "mug", block(1000))
    mine = cache.folder / "thesis.txt"
    mine.write_text("mine")
    assert cache.clear() > 1000
    assert list(cache.folder.iterdir()) == [mine]


@pytest.mark.parametrize("value", ["off", "OFF", "0", "no"])
def test_the_environment_switches_it_off(monkeypatch, value):
    monkeypatch.setenv("GPIS_GRASP_CACHE", value)
    cache = DiskCache.of(CacheSettings())
    assert cache.folder is None
    cache.put("object", "mug", block(10))
    assert cache.get("object", "mug") is None
    assert cache.entries() == []


def test_settings_come_before_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("GPIS_GRASP_CACHE", str(tmp_path / "one"))
    assert DiskCache.of(CacheSettings()).folder == tmp_path / "one"
    two = CacheSettings(directory=str(tmp_path / "two"), most_megabytes=3)
    assert DiskCache.of(two).folder == tmp_path / "two"
    assert DiskCache.of(two).most_bytes == 3_000_000
    assert DiskCache.of(CacheSettings(most_megabytes=0)).folder is None


def test_without_either_it_lies_in_the_users_cache(monkeypatch, tmp_path):
    monkeypatch.delenv("GPIS_GRASP_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert DiskCache.of(CacheSettings()).folder == tmp_path / "gpis_grasp_planner" / "objects"
    monkeypatch.setattr(disk_cache, "user_cache", lambda: None)
    assert DiskCache.of(CacheSettings()).folder is None


def test_the_code_version_follows_the_folders_that_are_named():
    assert code_version("geometry") != code_version("geometry", "surface")
    assert code_version("geometry") == code_version("geometry")
