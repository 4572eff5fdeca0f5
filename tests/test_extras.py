"""The core plans without any optional library; what needs one says which, and how to get it."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from test_architecture import PACKAGE, imported_names

OPTIONAL = (
    "cascadio", "coal", "distributed", "eaik", "matplotlib", "mujoco", "open3d", "PIL", "viser",
)  # fmt: skip
# Distributions whose module has another name.
MODULES = {"fast-simplification": "fast_simplification", "pillow": "PIL", "PyYAML": "yaml"}


def declared() -> tuple[list[str], dict[str, list[str]]]:
    """What setup.py requires, and its extras."""
    tree = ast.parse((PACKAGE.parent / "setup.py").read_text(encoding="utf-8"))
    [call] = [n for n in ast.walk(tree) if isinstance(n, ast.Call) and _name(n) == "setup"]
    values = {k.arg: k.value for k in call.keywords}
    return (
        ast.literal_eval(values["install_requires"]),
        ast.literal_eval(values["extras_require"]),
    )


def _name(call: ast.Call) -> str:
    return call.func.id if isinstance(call.func, ast.Name) else ""


def without_extras(*words: object) -> subprocess.CompletedProcess[str]:
    """The command in a process in which no optional library can be imported."""
    program = (
        f"import sys; sys.modules.update(dict.fromkeys({OPTIONAL!r}))\n"
        "from gpis_grasp_planner.cli.main import main\nsys.exit(main(sys.argv[1:]))"
    )
    return subprocess.run(
        [sys.executable, "-c", program, *map(str, words)],
        text=True,
        capture_output=True,
        check=False,
    )


def test_everything_required_is_imported_and_nothing_optional_is_required() -> None:
    required, extras = declared()
    imported = set()
    for path in PACKAGE.rglob("*.py"):
        names = imported_names(path.read_text(encoding="utf-8"), str(path.relative_to(PACKAGE)))
        imported |= {name.partition(".")[0] for name in names}
    # STEP is read by a program of its own, whose text the reader holds.
    assert {MODULES.get(name, name) for name in required} <= imported
    optional = {MODULES.get(name, name) for names in extras.values() for name in names}
    assert optional == set(OPTIONAL)
    assert optional - imported == {"cascadio"}
    assert not optional & {MODULES.get(name, name) for name in required}


def test_the_core_plans_and_tries_in_physics() -> None:
    answer = without_extras("plan", "bracket", "--evaluations", 300, "--grasps", 1, "--seed", 3)
    assert answer.returncode == 0, answer.stderr
    assert "epsilon" in answer.stdout
    assert "holds" in answer.stdout


def write_cloud(path: Path) -> Path:
    rng = np.random.default_rng(1)
    points = rng.normal(size=(3000, 3))
    np.savetxt(path, 0.03 * points / np.linalg.norm(points, axis=1, keepdims=True))
    return path


@pytest.mark.parametrize(
    ("words", "library", "extra"),
    [
        (["plan", "mug", "--picture", "mug.png"], "Pillow", "pictures"),
        (["plan-all", ".", "--report", "report"], "Pillow", "pictures"),
        (["plan", "box.step"], "cascadio", "step"),
        (["plan", "ball.xyz", "--unit", "m"], "Open3D", "cloud"),
        (["view", "mug"], "viser", "view"),
        (["plan-all", ".", "--scheduler", "tcp://127.0.0.1:1"], "Dask distributed", "cluster"),
        (["worker", "tcp://127.0.0.1:1"], "Dask distributed", "cluster"),
    ],
)
def test_what_needs_an_extra_says_so_in_one_line(
    words: list[str], library: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "box.step").write_text("ISO-10303-21;\n")  # refused before it is read
    write_cloud(tmp_path / "ball.xyz")
    answer = without_extras(*words)
    assert answer.returncode == 1
    assert answer.stdout == ""
    [line] = answer.stderr.splitlines()
    assert f"needs {library}: not installed here" in line
    assert line.endswith(f"pip install 'gpis-grasp-planner[{extra}]'.")
    assert extra in declared()[1]
    assert not (tmp_path / "report").exists()
