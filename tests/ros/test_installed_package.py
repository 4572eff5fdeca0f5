"""The package as colcon installs it, started without the sources; and what it has in its share."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "ros2_ws/src/gpis_grasp_planner"
# Compiled code is known by the sources' content, wherever they are: the same here and there.
COMPILED = os.environ.get("NUMBA_CACHE_DIR", SOURCE / "gpis_grasp_planner/__pycache__")
LAUNCH = SOURCE / "launch/grasp_planner.launch.py"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Prefix of an installation whose sources are gone."""
    workspace = tmp_path_factory.mktemp("workspace")
    skip = shutil.ignore_patterns("__pycache__", "*.egg-info", ".numba_cache")
    shutil.copytree(SOURCE, workspace / "src/gpis_grasp_planner", ignore=skip)
    subprocess.run(
        ["colcon", "--log-level", "error", "build", "--packages-select", "gpis_grasp_planner"],
        cwd=workspace,
        env=environment(),
        check=True,
        capture_output=True,
        text=True,
    )
    shutil.rmtree(workspace / "src")
    shutil.rmtree(workspace / "build")
    return workspace / "install/gpis_grasp_planner"


def environment(prefix: Path | None = None) -> dict[str, str]:
    """Without the sources in the path; with a prefix, as its setup file makes it."""
    values = dict(os.environ)
    others = [
        p for p in values.get("PYTHONPATH", "").split(":") if p and "gpis_grasp_planner" not in p
    ]
    if prefix is not None:
        others = [str(site_packages(prefix)), *others]
        values["AMENT_PREFIX_PATH"] = f"{prefix}:{values['AMENT_PREFIX_PATH']}"
    values["PYTHONPATH"] = ":".join(p for p in others if p != str(ROOT / "benchmark"))
    return values


def site_packages(prefix: Path) -> Path:
    [found] = prefix.glob("lib/python3*/site-packages")
    return found


def imported_files(log: str) -> set[str]:
    """Files of the planner that a Python with PYTHONVERBOSE has named."""
    words = (word.strip("'\"") for line in log.splitlines() for word in line.split())
    return {w for w in words if "/gpis_grasp_planner/" in w and w.endswith((".py", ".pyc"))}


@pytest.fixture(scope="module")
def node(installed: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """The installed program with the installed parameter file, and where it writes."""
    log = tmp_path_factory.mktemp("installed") / "node.log"
    command = [
        installed / "lib/gpis_grasp_planner/grasp_planner_node",
        *("--ros-args", "--params-file"),
        installed / "share/gpis_grasp_planner/config/grasp_planner.yaml",
        *("-p", "default_verification:=none", "-p", "planning_grace_s:=120.0"),
    ]
    with log.open("wb") as output:
        process = subprocess.Popen(
            command,
            stdout=output,
            stderr=output,
            cwd=log.parent,
            env=environment(installed) | {"PYTHONVERBOSE": "1", "NUMBA_CACHE_DIR": str(COMPILED)},
        )
    yield process, log
    process.terminate()
    process.wait(60.0)


def test_the_installed_node_plans_without_the_sources(
    node: Any, client: Any, tools: Any, installed: Path
) -> None:
    process, log = node
    ready = lambda: "Ready: service" in log.read_text(errors="replace")  # noqa: E731
    tools.wait(lambda: ready() or process.poll() is not None, "the node", 180.0)
    assert ready(), log.read_text(errors="replace")[-3000:]
    response, tries = client.plan("sphere", time_budget=5.0), 0
    while not response.success and tries < 30:  # a part that is still being prepared goes on
        response, tries = client.plan("sphere", time_budget=5.0), tries + 1
    assert response.success, response.message
    process.terminate()
    assert process.wait(60.0) == 0
    files = imported_files(log.read_text(errors="replace"))
    assert len(files) > 100
    inside = {file for file in files if file.startswith(str(site_packages(installed)))}
    assert files == inside


def test_the_share_has_what_is_there_for_others(installed: Path) -> None:
    share = installed / "share/gpis_grasp_planner"
    for folder in ("config", "foxglove", "launch", "policies", "rviz"):
        here = {p.name for p in (share / folder).iterdir()}
        assert here == {p.name for p in (SOURCE / folder).iterdir() if p.is_file()}, folder
    assert (share / "package.xml").is_file()


def test_the_launch_file_names_what_the_package_has(installed: Path) -> None:
    """By its text alone: the package `launch` is not among the ROS wheels."""
    tree = ast.parse(LAUNCH.read_text())
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    programs = {
        ast.literal_eval(k.value) for c in calls for k in c.keywords if k.arg == "executable"
    } - {"rviz2"}
    assert programs == {p.name for p in (installed / "lib/gpis_grasp_planner").iterdir()} - {
        "gpis-grasp"
    }
    paths = [
        [ast.literal_eval(part) for part in call.args[0].elts[1:]]
        for call in calls
        if isinstance(call.func, ast.Name) and call.func.id == "PathJoinSubstitution"
    ]
    assert len(paths) == 2
    for path in paths:
        assert Path(installed, "share/gpis_grasp_planner", *path).is_file()
