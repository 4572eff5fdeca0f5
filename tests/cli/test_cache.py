"""The command 'cache' on a folder of its own."""

from __future__ import annotations

import json

import numpy as np
import pytest

from gpis_grasp_planner.disk_cache import DiskCache


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("GPIS_GRASP_CACHE", str(tmp_path / "objects"))
    cache = DiskCache(tmp_path / "objects")
    cache.put("object", "mug", {"a": np.zeros(1000)})
    cache.put("object", "flask", {"a": np.zeros(2000)})
    return tmp_path / "objects"


def test_it_lists_what_is_there(gpis_grasp, folder):
    answer = gpis_grasp("cache")
    assert answer.code == 0
    *lines, last = answer.out.splitlines()
    assert len(lines) == 2
    assert all(line.startswith("object-") for line in lines)
    assert last == f"2 entries, 0.0 of 500 MB in {folder}"


def test_the_list_as_json(gpis_grasp, folder):
    facts = json.loads(gpis_grasp("cache", "list", "--json").out)
    assert facts["folder"] == str(folder)
    assert {e["name"] for e in facts["entries"]} == {p.name for p in folder.iterdir()}
    assert facts["bytes"] == sum(p.stat().st_size for p in folder.iterdir())
    assert {e["kind"] for e in facts["entries"]} == {"object"}


def test_clear_removes_it(gpis_grasp, folder):
    n_bytes = sum(p.stat().st_size for p in folder.iterdir())
    facts = json.loads(gpis_grasp("cache", "clear", "--json").out)
    assert facts["removed_bytes"] == n_bytes
    assert facts["bytes"] == 0
    assert list(folder.iterdir()) == []


def test_path_is_the_folder_alone(gpis_grasp, folder):
    assert gpis_grasp("cache", "path").out == f"{folder}\n"
    other = folder.parent / "other"
    answer = gpis_grasp("cache", "path", "--set", f"cache.directory={other}")
    assert answer.out == f"{other}\n"


def test_off_is_said(gpis_grasp, monkeypatch):
    monkeypatch.setenv("GPIS_GRASP_CACHE", "off")
    assert "switched off" in gpis_grasp("cache").out
    assert json.loads(gpis_grasp("cache", "path", "--json").out)["folder"] is None
