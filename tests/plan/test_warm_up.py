from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gpis_grasp_planner import errors
from gpis_grasp_planner.errors import RequestError
from gpis_grasp_planner.plan import warm_up as module
from gpis_grasp_planner.plan.warm_up import (
    box_part,
    compile_side_by_side,
    main,
    make_ready,
    warm_up,
)

PACKAGE_ROOT = Path(errors.__file__).parents[1]


def test_it_finds_grasps_and_says_what_it_does(capsys) -> None:
    assert main() == 0
    said = capsys.readouterr().out
    assert "implicit surface" in said
    assert "planner hpp" in said
    assert "grasps of a box" in said


def test_one_planner_alone() -> None:
    said: list[str] = []
    assert warm_up(["random-adaption"], said.append) > 0
    steps = [line.split(":")[0] for line in said]
    assert steps[-4:] == ["planner random-adaption", "confirmation", "placing", "trials"]


def test_a_planner_that_finds_nothing_in_so_few_attempts() -> None:
    """A rival of the benchmark, which closes a hundredth of the hands."""
    said: list[str] = []
    assert warm_up(["annealing"], said.append) > 0
    assert [line.split(":")[0] for line in said if line.startswith("planner")] == [
        "planner annealing",
        "planner random-adaption",
    ]


def test_the_box_is_closed_and_faces_outwards() -> None:
    part = box_part()
    corners = part.mesh.triangles
    volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
    np.testing.assert_allclose(volume, part.volume, rtol=1e-12)
    np.testing.assert_allclose(part.mesh.extent, [0.04, 0.05, 0.07])


def test_a_plan_after_it_compiles_nothing_more(tmp_path: Path) -> None:
    """No function has a new signature after a real part is planned and placed, a cloud read."""
    program = """
import sys
from pathlib import Path
import numpy as np
from numba.core.registry import CPUDispatcher
from gpis_grasp_planner.plan.warm_up import load_compiled, warm_up
from gpis_grasp_planner.plan.planner import GraspPlanner
from gpis_grasp_planner.surroundings.place import Place
from gpis_grasp_planner.plan.settings import PlannerSettings
from gpis_grasp_planner.surroundings.uncertainty_settings import UncertaintySettings
from gpis_grasp_planner.geometry.catalogue import MeshCatalogue, default_catalogue_directory
from gpis_grasp_planner.geometry.catalogue import load_part
from gpis_grasp_planner.plan.request import PlanRequest

def signatures():
    modules = [m for n, m in sys.modules.items() if n.startswith("gpis_grasp_planner")]
    return {
        f"{d.py_func.__module__}.{d.py_func.__name__} {s}"
        for m in modules for d in vars(m).values() if isinstance(d, CPUDispatcher)
        for s in d.signatures
    }

load_compiled()
loaded = signatures()
warm_up(["dual"])
before = signatures()
print(len(loaded), len(before))
print(*sorted(loaded - before))
part = MeshCatalogue([default_catalogue_directory()]).load("flask")
request = PlanRequest(planner="dual", max_evaluations=128, n_grasps=2, time_budget_s=120.0)
place = Place.from_mapping({
    "support": {"point": part.mesh.bounds[0].tolist()},
    "obstacles": [
        {"position": [0.2, 0, 0], "size": [0.1, 0.1, 0.1]},
        {"position": [0, 0.3, 0], "mesh": "flask"},
    ],
    "covariance": [1e-6] * 6,
}, lambda _: part.mesh)
settings = PlannerSettings(uncertainty=UncertaintySettings(method="unscented"))
GraspPlanner(settings).answer(part, request, place)
way = np.random.default_rng(0).normal(size=(800, 3))
np.savetxt(sys.argv[1], 0.03 * way / np.linalg.norm(way, axis=1, keepdims=True))
load_part(Path(sys.argv[1]), "m")
print(*sorted(signatures() - before), sep="\\n")
"""
    run = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path / "ball.xyz")],
        env={**os.environ, "PYTHONPATH": str(PACKAGE_ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    counts, useless, *new = run.stdout.split("\n")
    n_loaded, n_before = map(int, counts.split())
    assert 10 < n_loaded < n_before
    assert useless == ""
    assert "".join(new) == ""


def test_what_has_been_compiled_is_not_compiled_again(monkeypatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(module, "warm_up", asked.extend)
    monkeypatch.setattr(module, "is_ready", lambda planner: planner == "hpp")
    assert not make_ready("hpp")
    assert make_ready("dual")
    assert asked == ["dual"]
    with pytest.raises(RequestError, match="nonsense"):
        make_ready("nonsense")


def test_two_halves_are_compiled_by_two_processes(monkeypatch) -> None:
    shared: list[object] = []
    monkeypatch.setattr(module, "share_out", lambda serve, groups, n: shared.extend([*groups, n]))
    compile_side_by_side()
    assert shared == ["attempts", "moves", 2]


def test_nothing_is_compiled_side_by_side_where_all_is_ready(monkeypatch) -> None:
    monkeypatch.setattr(module, "is_ready", lambda planner: True)
    monkeypatch.setattr(module, "warm_up", lambda say: 1)
    monkeypatch.setattr(module, "compile_side_by_side", None)
    assert main() == 0


def test_a_warm_up_says_for_which_planner_it_was(monkeypatch) -> None:
    ready: list[str] = []
    monkeypatch.setattr(module, "mark_ready", ready.append)
    warm_up(["random"])
    assert ready == ["random"]
