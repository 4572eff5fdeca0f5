"""Every picture of 'render' by its command: a file of the right kind, with what it should show."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image


@pytest.fixture(scope="module")
def document(tmp_path_factory, request) -> Path:
    """Three grasps of the mug on a table, without trials."""
    import subprocess
    import sys

    path = tmp_path_factory.mktemp("render") / "mug.json"
    words = "--support lowest --seed 3 --evaluations 600 --time 60 --verify none --grasps 3 --json"
    command = [sys.executable, "-m", "gpis_grasp_planner.cli.main", "plan", "mug"]
    subprocess.run([*command, *words.split(), path], check=True, capture_output=True)
    return path


def drawn(gpis_grasp, document: Path, *words: str) -> np.ndarray:
    path = document.with_name("picture.png")
    answer = gpis_grasp("render", document, *words, "--picture", path)
    assert answer.code == 0, answer.err
    assert answer.out == ""
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


def near(pixels: np.ndarray, color: tuple[int, int, int]) -> int:
    return int((np.abs(pixels - np.array(color)).max(axis=-1) < 25).sum())


def test_a_sheet_has_a_cell_for_each_grasp(gpis_grasp, document: Path) -> None:
    n = len(json.loads(document.read_text())["grasps"])
    assert n > 1
    sheet = drawn(gpis_grasp, document, "--sheet")
    assert sheet.shape == (360, 480 * n, 3)
    for k in range(n):
        cell = sheet[:, 480 * k : 480 * (k + 1)]
        assert near(cell, (210, 140, 50)) > 500  # the mug


def test_lost_palms_have_the_colours_of_their_legend(gpis_grasp, document: Path) -> None:
    picture = drawn(gpis_grasp, document, "--lost")
    assert picture.shape[0] == 750
    shown, legend = picture[:, :1000], picture[:, 1000:]
    assert (legend == 255).mean() > 0.7
    causes = {entry["cause"] for entry in json.loads(document.read_text())["lost_palms"]}
    assert "no force closure" in causes
    blue = (20, 80, 170)
    assert near(legend, blue) > 20
    assert near(shown, blue) > 100


def test_convergence_and_slice_are_plots(gpis_grasp, document: Path) -> None:
    convergence = drawn(gpis_grasp, document, "--convergence")
    assert convergence.shape == (504, 840, 3)
    assert near(convergence, (31, 119, 180)) > 300
    cut = drawn(gpis_grasp, document, "--slice")
    assert cut.shape == (576, 1320, 3)
    assert near(cut, (255, 165, 0)) > 500  # the mesh's section


def test_the_error_of_the_surface_is_told_in_millimetres(gpis_grasp, document: Path) -> None:
    picture = drawn(gpis_grasp, document, "--surface-error")
    assert picture.shape[0] == 750
    shown = picture[:, :1000]
    saturation = shown.max(axis=2) - shown.min(axis=2)
    # The mug's walls are within the middle bin, grey; parts of rim and handle are not.
    assert 0.02 < (saturation > 40).mean() < 0.35


def test_one_picture_at_a_time(gpis_grasp, document: Path, tmp_path: Path) -> None:
    answer = gpis_grasp("render", document, "--sheet", "--lost", "--picture", tmp_path / "p.png")
    assert answer.code == 2
    assert "not allowed with" in answer.err


def test_plan_explained_draws_where_hands_were_lost(gpis_grasp, tmp_path: Path) -> None:
    words = "--support lowest --seed 3 --evaluations 300 --time 60 --verify none --grasps 3"
    path = tmp_path / "explained.png"
    answer = gpis_grasp("plan", "mug", *words.split(), "--explain", "--picture", path)
    assert answer.code == 0, answer.err
    with Image.open(path) as image:
        width, height = image.size
    assert height == 750
    assert width > 2000  # the grasp, the lost palms, their legend


def test_json_says_which_grasp_was_drawn_and_what_else(gpis_grasp, document: Path) -> None:
    grasps = json.loads(document.read_text())["grasps"]
    path = document.with_name("second.png")
    answer = gpis_grasp("render", document, "--index", "1", "--picture", path, "--json")
    said = json.loads(answer.out)
    assert said == {
        "picture": str(path),
        "mesh_id": "mug",
        "index": 1,
        "epsilon": pytest.approx(grasps[1]["epsilon"]),
    }
    answer = gpis_grasp("render", document, "--sheet", "--picture", path, "--json")
    assert json.loads(answer.out) == {"picture": str(path), "mesh_id": "mug"}
