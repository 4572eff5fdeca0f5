from __future__ import annotations

import json
from pathlib import Path

import pytest

from gpis_grasp_planner.cli.main import main
from gpis_grasp_planner.verification.settings import VerificationSettings


@pytest.fixture(scope="module")
def document(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two grasps of the shipped ball."""
    file = tmp_path_factory.mktemp("verify") / "grasps.json"
    options = ["--planner", "random-adaption", "--evaluations", "192", "--grasps", "2"]
    options += ["--time", "120"]
    options += ["--verify", "none"]
    assert main(["plan", "sphere", *options, "--json", str(file)]) == 0
    return file


def test_every_grasp_has_its_verdict(gpis_grasp, document: Path, tmp_path: Path) -> None:
    file = tmp_path / "verdicts.json"
    answer = gpis_grasp("verify", document, "--friction", 0.9, "--mass", 0.05, "--json", file)
    values = json.loads(file.read_text())
    planned = json.loads(document.read_text())
    assert values["mesh_hash"] == planned["mesh_hash"]
    assert values["settings"] == VerificationSettings(friction=0.9, mass_kg=0.05).as_dict()
    assert [g["index"] for g in values["grasps"]] == list(range(len(planned["grasps"])))
    held = [g["held"] for g in values["grasps"]]
    assert values["n_held"] == sum(held)
    assert answer.code == (0 if any(held) else 3)
    assert f"{sum(held)} of {len(held)} grasps hold at friction 0.9 and 0.05 kg" in answer.out
    assert all(bool(g["cause"]) != g["held"] for g in values["grasps"])


def test_without_friction_nothing_holds_and_that_is_3(gpis_grasp, document: Path) -> None:
    answer = gpis_grasp("verify", document, "--friction", 0, "--json", "-")
    assert answer.code == 3
    assert json.loads(answer.out)["n_held"] == 0
    assert "NO_GRASP_HOLDS" in answer.err


@pytest.mark.parametrize(
    ("extra", "word"),
    [
        (("--mass", "0"), "mass_kg"),
        (("--cores", "0"), "--cores is 0"),
        (("--mesh", "mug"), "the document was made for"),
        (("--set", "verification.rate_hz=1"), "rate_hz"),
    ],
)
def test_bad_requests(gpis_grasp, document: Path, extra: tuple[str, ...], word: str) -> None:
    answer = gpis_grasp("verify", document, *extra)
    assert answer.code == 1
    assert word in answer.err
