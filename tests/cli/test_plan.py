"""'plan' and what reads its documents: 'render'."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from gpis_grasp_planner.cli import options
from gpis_grasp_planner.geometry.catalogue import default_catalogue_directory
from gpis_grasp_planner.plan.document import read_document

QUICK = (  # the evaluations end it, also on a machine that is busy with other things
    *("--time", "120", "--planner", "random-adaption", "--evaluations", "192", "--grasps", "3"),
    *("--verify", "none"),
)


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A document of a mesh outside the catalogue, planned with a picture."""
    from gpis_grasp_planner.cli.main import main

    folder = tmp_path_factory.mktemp("planned")
    mesh = folder / "ball.stl"
    mesh.write_bytes((default_catalogue_directory() / "sphere.stl").read_bytes())
    arguments = ["plan", str(mesh), "--unit", "mm", "--friction", "0.8", *QUICK]
    files = ["--json", str(folder / "grasps.json"), "--picture", str(folder / "best.png")]
    assert main([*arguments, *files]) == 0
    return folder / "grasps.json"


def test_the_document_says_what_was_asked_for(planned: Path) -> None:
    document = json.loads(planned.read_text())
    assert document["status"] == "SUCCESS"
    assert document["planner"] == "random-adaption"
    assert document["friction"] == {"finger": 0.8, "palm": 0.8}
    assert document["mesh_source"] == {"file": str(planned.with_name("ball.stl")), "unit": "mm"}
    assert 1 <= len(document["grasps"]) <= 3
    weight = document["settings"]["hpp"]["volume_weight"]
    ranks = [g["epsilon"] + weight * g["volume"] for g in document["grasps"]]
    assert ranks == sorted(ranks, reverse=True)
    assert document["n_evaluations"] >= 192
    assert all(c["friction"] == 0.8 for g in document["grasps"] for c in g["contacts"])
    phases = document["phase_s"]
    assert {"reading", "preparing", "searching"} <= set(phases)
    assert 0.0 < phases["reading"] < sum(phases.values()) <= document["elapsed_s"] + 1e-6


def test_reading_counts_and_it_is_said_where_little_was_left_for_the_search(
    gpis_grasp, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reader_of = options.reader_of

    def slow_reader_of(*arguments: Any) -> Any:
        read = reader_of(*arguments)

        def read_slowly() -> Any:
            time.sleep(4.0)
            return read()

        return read_slowly

    monkeypatch.setattr(options, "reader_of", slow_reader_of)
    file = tmp_path / "sphere.json"
    answer = gpis_grasp(*("plan", "sphere", "--time", "6", "--verify", "none", "--json", file))
    assert "note: Reading and preparing the part took" in answer.err
    assert " s of 6 s; --time " in answer.err
    document = json.loads(file.read_text())
    assert document["phase_s"]["reading"] >= 4.0
    assert document["elapsed_s"] >= 4.0 + document["phase_s"]["searching"]


def test_the_picture_is_one(planned: Path) -> None:
    with Image.open(planned.with_name("best.png")) as image:
        assert image.size == (1000, 750)
        assert np.asarray(image).std() > 10.0


def test_the_same_seed_gives_the_same_document(gpis_grasp, planned: Path) -> None:
    again = planned.with_name("again.json")
    mesh = planned.with_name("ball.stl")
    answer = gpis_grasp("plan", mesh, "--unit", "mm", "--friction", 0.8, *QUICK, "--json", again)
    assert answer.code == 0
    assert f"{0:>3}" in answer.out
    assert "192 attempts in" in answer.out
    first, second = (json.loads(path.read_text()) for path in (planned, again))
    assert first["grasps"] == second["grasps"]
    best = first["grasps"][0]["epsilon"]
    assert f"{best:.4f}" in answer.out


def test_explain_shows_the_documents_funnel(gpis_grasp, tmp_path: Path) -> None:
    file = tmp_path / "sphere.json"
    answer = gpis_grasp("plan", "sphere", "--friction", 0.8, *QUICK, "--json", file, "--explain")
    assert answer.code == 0, answer.err
    table = answer.out[answer.out.index("step ") :].splitlines()[2:]
    rows = json.loads(file.read_text())["funnel"]
    assert rows[0]["left"] >= 192
    for line, row in zip(table, rows, strict=False):
        assert line.startswith(row["step"])
        assert line[len(row["step"]) :].split()[0] == str(row["left"])
        assert all(f"{cause} {n}" in line for cause, n in row["lost"].items())
    assert "Main loss: " in answer.out


def test_json_on_stdout_is_alone_there(gpis_grasp) -> None:
    answer = gpis_grasp("plan", "sphere", *QUICK, "--json", "-")
    assert answer.code == 0
    document = json.loads(answer.out)
    assert document["mesh_source"] is None
    assert document["mesh_id"] == "sphere"
    assert document["friction"] == {"finger": 0.4, "palm": 0.3}


def test_no_grasp_is_3_and_the_document_is_written(gpis_grasp, tmp_path: Path) -> None:
    file, mesh = tmp_path / "none.json", tmp_path / "crate.stl"
    trimesh.creation.box((0.5, 0.5, 0.5)).export(mesh)  # no hand spans it
    answer = gpis_grasp("plan", mesh, "--unit", "m", *QUICK, "--json", file)
    assert answer.code == 3
    assert "NO_FEASIBLE_GRASP: No grasp with force closure of 'crate'" in answer.err
    assert json.loads(file.read_text())["grasps"] == []


def test_a_table_an_obstacle_and_an_uncertain_pose(gpis_grasp, tmp_path: Path) -> None:
    scene, file = tmp_path / "scene.yaml", tmp_path / "grasps.json"
    scene.write_text(
        "object: {position: [0.5, 0.0, 0.8]}\n"
        "support: {point: [0, 0, 0.7]}\n"
        "obstacles:\n"
        "  - {name: wall, position: [0.8, 0, 0.8], size: [0.02, 1, 1]}\n"
        "  - {name: other, position: [0.5, 0.5, 0.8], mesh: mug}\n"
    )
    answer = gpis_grasp(
        "plan", "sphere", *QUICK, "--verify", "none", "--scene", scene, "--sigma-mm", 2,
        "--set", "uncertainty.method=unscented", "--json", file,
    )  # fmt: skip
    assert answer.code == 0, answer.err
    assert "P(hold)" in answer.out
    assert "probability to hold" in answer.out
    document = json.loads(file.read_text())
    assert document["place"]["support"]["point"] == [0.0, 0.0, 0.7]
    assert [o["name"] for o in document["place"]["obstacles"]] == ["wall", "other"]
    assert document["place"]["obstacles"][1]["mesh"] == "mug"
    assert np.diag(np.reshape(document["place"]["covariance"], (6, 6))) == pytest.approx(
        [4e-6, 4e-6, 4e-6, 0, 0, 0]
    )
    held = [g["hold_probability"] for g in document["grasps"]]
    assert held == sorted(held, reverse=True)
    assert all(0.0 <= p <= 1.0 for p in held)
    assert all(g["lift_direction"] == [0.0, 0.0, 1.0] for g in document["grasps"])
    read = read_document(file).result
    assert read.place == document["place"]
    assert [g.hold_probability for g in read.grasps] == held


def test_a_support_alone_keeps_the_hand_above_it(gpis_grasp, tmp_path: Path) -> None:
    file = tmp_path / "grasps.json"
    answer = gpis_grasp(
        "plan", "sphere", *QUICK, "--verify", "none", "--support", "lowest", "--json", file
    )
    assert answer.code == 0, answer.err
    document = json.loads(file.read_text())
    radius = -document["place"]["support"]["point"][2]
    assert radius == pytest.approx(0.05, abs=0.02)
    assert document["place"]["support"]["normal"] == [0.0, 0.0, 1.0]
    for grasp in document["grasps"]:
        assert grasp["palm_pose"]["position"][2] > -radius
        assert grasp["hold_probability"] is None


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("plan", "mug", "--support", "high"), "--support is 'high'"),
        (("plan", "mug", "--scene", "nowhere.yaml"), "nowhere.yaml: No such file"),
        (("plan", "mug", "--scene", "BAD"), "neither YAML nor JSON"),
        (("plan", "mug", "--scene", "TABLE"), "unknown name 'table'"),
        (("plan", "mug", "--scene", "SUPPORT", "--support", "0"), "Both --support"),
        (("plan", "mug", "--covariance", "1,2"), "2 numbers"),
        (("plan", "mug", "--covariance", "a,b"), "give numbers"),
        (("plan", "mug", "--covariance=-1,0,0,0,0,0"), "negative eigenvalue"),
        (("plan", "mug", "--covariance", "0,0,0,0,0,0", "--sigma-mm", "1"), "either"),
        (("plan", "mug", "--sigma-deg", "-1"), "--sigma-deg is -1"),
        (("plan", "mug", "--set", "clearance.margin_m=1"), "margin_m"),
    ],
)
def test_a_bad_place_is_1_with_a_reason(
    gpis_grasp, tmp_path: Path, arguments: tuple, word: str
) -> None:
    texts = {"BAD": "a: [", "TABLE": "table: {}", "SUPPORT": "support: {}"}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    answer = gpis_grasp(*(tmp_path / a if a in texts else a for a in arguments))
    assert answer.code == 1
    [line] = answer.err.splitlines()
    assert word.lower() in line.lower()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("plan", "mugg"), "Nearest known IDs: mug"),
        (("plan", "mug", "--planner", "best"), "Unknown planner 'best'"),
        (("plan", "mug", "--time", "0"), "time budget"),
        (("plan", "mug", "--grasps", "0"), "number of grasps"),
        (("plan", "mug", "--friction", "-1"), "friction of the finger"),
        (("plan", "mug", "--seed", "-1"), "seed"),
        (("plan", "mug", "--evaluations", "0"), "limit of evaluations"),
        (("plan", "mug", "--set", "hpp.batch=0"), "batch"),
        (("plan", "mug", "--settings", "nowhere.yaml"), "nowhere.yaml: No such file"),
        (("plan", "mug", "--json", "nowhere/a.json"), "needs the directory nowhere"),
        (("plan", "mug", "--picture", "nowhere/a.png"), "needs the directory nowhere"),
        (("plan", "mug", "--picture", "best"), "no suffix, which names the format. Write best.png"),
        (("plan", "mug", "--picture", "a.foo"), "unknown suffix .foo"),
        (("plan", "nothere.step"), "No such file: nothere.step"),
        (("plan", "mug", "--meshes", "nowhere"), "'nowhere' does not exist"),
    ],
)
def test_bad_requests_are_1_with_a_reason(gpis_grasp, arguments: tuple, word: str) -> None:
    answer = gpis_grasp(*arguments)
    assert answer.code == 1
    assert answer.out == ""
    [line] = answer.err.splitlines()
    assert line.startswith("gpis-grasp: error: ")
    assert word in line


def test_render_draws_each_grasp(gpis_grasp, planned: Path, tmp_path: Path) -> None:
    picture = tmp_path / "grasp.png"
    drawn = gpis_grasp("render", planned, "--picture", picture, "--json")
    assert drawn.code == 0
    assert json.loads(drawn.out)["picture"] == str(picture)
    with Image.open(picture) as image, Image.open(planned.with_name("best.png")) as best:
        # The pose went through a quaternion: a few pixels on edges differ by a shade.
        drawn, first = np.asarray(image, dtype=int), np.asarray(best, dtype=int)
    assert np.abs(drawn - first).mean() < 0.01


def test_render_finds_the_mesh_beside_a_moved_document(
    gpis_grasp, planned: Path, tmp_path: Path
) -> None:
    document = json.loads(planned.read_text())
    document["mesh_source"]["file"] = "somewhere/else/ball.stl"
    (tmp_path / "moved.json").write_text(json.dumps(document))
    arguments = ("render", tmp_path / "moved.json", "--picture", tmp_path / "p.png")
    answer = gpis_grasp(*arguments)
    assert answer.code == 1
    assert "ball.stl" in answer.err
    (tmp_path / "ball.stl").write_bytes(planned.with_name("ball.stl").read_bytes())
    assert gpis_grasp(*arguments).code == 0


def test_render_finds_the_mesh_of_a_catalogue_of_ones_own(gpis_grasp, tmp_path: Path) -> None:
    parts, document = tmp_path / "parts", tmp_path / "grasps.json"
    parts.mkdir()
    for name in ("sphere.stl", "sphere.yaml"):
        there = default_catalogue_directory() / name
        (parts / name.replace("sphere", "ball")).write_bytes(there.read_bytes())
    answer = gpis_grasp("plan", "ball", "--meshes", parts, *QUICK, "--json", document)
    assert answer.code == 0, answer.err
    arguments = ("render", document, "--picture", tmp_path / "p.png")
    answer = gpis_grasp(*arguments)
    assert answer.code == 0, answer.err
    parts.rename(tmp_path / "moved")
    answer = gpis_grasp(*arguments)
    assert answer.code == 1
    assert "--meshes" in answer.err
    assert gpis_grasp(*arguments, "--meshes", tmp_path / "moved").code == 0


def test_a_part_that_no_hand_can_take_is_answered_without_a_search(
    gpis_grasp, tmp_path: Path
) -> None:
    mesh = tmp_path / "sheet.stl"
    trimesh.creation.box((0.12, 0.04, 0.002)).export(mesh)
    answer = gpis_grasp("plan", mesh, "--unit", "m", "--support", "lowest", "--explain")
    assert answer.code == 3
    assert "without a search" in answer.out
    assert "more time" not in answer.err.lower()


@pytest.mark.parametrize(
    ("extra", "word"),
    [
        (("--index", 99), "Grasp 99 is not in"),
        (("--index", -1), "Grasp -1 is not in"),
        (("--mesh", "mug"), "the document was made for"),
    ],
)
def test_render_refuses(gpis_grasp, planned: Path, tmp_path: Path, extra: tuple, word: str) -> None:
    answer = gpis_grasp("render", planned, "--picture", tmp_path / "p.png", *extra)
    assert answer.code == 1
    assert word in answer.err
    assert not (tmp_path / "p.png").exists()


def test_grasps_are_tried_in_physics_by_default(gpis_grasp, tmp_path: Path) -> None:
    file = tmp_path / "tried.json"
    words = [word for word in QUICK if word not in ("--verify", "none")]
    answer = gpis_grasp("plan", "sphere", "--friction", 0.8, *words, "--json", file)
    assert answer.code == 0, answer.err
    assert "holds" in answer.out
    assert "Tried in physics" in answer.err
    document = json.loads(file.read_text())
    assert document["verification"] == "rank"
    trials = [grasp["trials"] for grasp in document["grasps"]]
    # without a deadline every finalist is tried once
    assert [len(of_grasp) for of_grasp in trials] == [1] * len(trials)
    passed = [of_grasp[0]["passed"] for of_grasp in trials]
    assert passed == sorted(passed, reverse=True)
    assert passed[0]
    assert gpis_grasp("verify", file).out.count(" yes ") == sum(passed)
