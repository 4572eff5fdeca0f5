"""The arrows of docs/architecture.md, kept by reading the imports of every module."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "ros2_ws/src/gpis_grasp_planner/gpis_grasp_planner"
MAX_LINES = 400

# Bottom first; a module imports from its own folder and from the levels below it.
LEVELS = (
    {"errors", "whole_file", "packed_arrays", "thread_limits"},
    {"compiled_cache"},
    {"compiled"},
    {"lanes"},
    {"settings", "forked_child", "extras", "registered"},
    {"disk_cache"},
    {"geometry"},
    {"surface", "hand"},
    {"quality"},
    {"grasp"},
    {"scene", "surroundings", "search"},
    {"verification", "arm"},
    {"plan"},
    {"store"},
    {"view"},
    {"batch", "ros"},
    {"cli"},
)
# Beside the tower: imports only these, and is imported by the searches and what is above them.
OPTIMISE_IMPORTS = {"errors", "settings"}
FOLDERS = set[str]().union(*LEVELS) | {"optimise"}
OPTIMISE_USERS = set[str]().union(*LEVELS[LEVELS.index({"scene", "surroundings", "search"}) :])

# Libraries that only one place of the package may import.
OWNERS = {
    "numba": ("compiled.py", "lanes.py"),
    "llvmlite": ("lanes.py",),
    "rclpy": ("ros/",),
    "pybullet": ("scene/bullet_world.py",),
    "pybullet_data": ("scene/bullet_world.py",),
    "mujoco": ("verification/mujoco/",),
    "sqlite3": ("store/database.py",),
    "threadpoolctl": ("thread_limits.py",),
    # Of other distributions: the benchmark, the tests.
    "gpis_grasp_benchmark": (),
    "trimesh": (),
    "coal": ("arm/collision.py",),
    "eaik": ("arm/inverse.py",),
    "cascadio": ("geometry/formats/step.py",),
    "manifold3d": (),
    "fast_simplification": ("geometry/simplification.py",),
    "open3d": ("geometry/cloud/library.py",),
    "matplotlib": ("view/",),
    "viser": ("view/page.py",),
    "distributed": ("batch/cluster.py",),
    "dask": ("batch/cluster.py",),
    "playwright": (),
    **dict.fromkeys(
        ("ament_index_python", "builtin_interfaces", "diagnostic_msgs", "geometry_msgs",
         "gpis_grasp_msgs", "moveit_msgs", "rcl_interfaces", "sensor_msgs", "std_msgs",
         "tf2_msgs", "trajectory_msgs", "vision_msgs", "visualization_msgs"),
        ("ros/",),
    ),
}  # fmt: skip


def imported_names(source: str, module: str) -> list[str]:
    """List the dotted names that ``module`` (a path inside the package) imports, anywhere in it."""
    here = ["gpis_grasp_planner", *Path(module).parts[:-1]]
    names = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Import():
                names += [alias.name for alias in node.names]
            case ast.ImportFrom():
                base = here[: len(here) - node.level + 1] if node.level else []
                stem = ".".join([*base, *([node.module] if node.module else [])])
                names += [f"{stem}.{alias.name}" for alias in node.names]
            case ast.Call(
                func=ast.Name(id="__import__" | "import_module")
                | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(name)), *_],
            ):
                names.append(name)
    return names


def folder_of(module: str) -> str:
    """Name the folder of the tree that a module belongs to; errors.py and settings.py count."""
    return Path(module).parts[0].removesuffix(".py")


def allowed_folders(folder: str) -> set[str]:
    """Folders that a module of ``folder`` may import."""
    if folder == "optimise":
        return {folder} | OPTIMISE_IMPORTS
    [level] = [i for i, names in enumerate(LEVELS) if folder in names]
    below = set[str]().union(*LEVELS[:level])
    return {folder} | below | ({"optimise"} if folder in OPTIMISE_USERS else set())


def faults(source: str, module: str) -> list[str]:
    """Say what is wrong with a module, given by its source and its path inside the package."""
    if folder_of(module) not in FOLDERS:
        return [f"{module} lies in a folder without a place in the tree"]
    found = []
    for name in imported_names(source, module):
        top, *rest = name.split(".")
        if top == "gpis_grasp_planner" and rest and not rest[0].startswith("__"):
            if rest[0] not in allowed_folders(folder_of(module)):
                found.append(f"{module} imports {name}: against the arrows")
        elif top in OWNERS and not module.startswith(OWNERS[top]):
            found.append(
                f"{module} imports {name}: only {' and '.join(OWNERS[top]) or 'others'} may"
            )
    lines = source.count("\n")
    if lines > MAX_LINES:
        found.append(f"{module} has {lines} lines, more than {MAX_LINES}")
    return found


def package_modules() -> list[Path]:
    """All modules of the package except the top ``__init__.py``."""
    return sorted(p for p in PACKAGE.rglob("*.py") if p != PACKAGE / "__init__.py")


def test_every_module_keeps_the_arrows() -> None:
    modules = package_modules()
    assert len(modules) > 10
    found = [
        fault
        for path in modules
        for fault in faults(path.read_text(), path.relative_to(PACKAGE).as_posix())
    ]
    assert not found, "\n".join(found)


def test_the_page_names_every_folder_and_owner() -> None:
    page = (ROOT / "docs/architecture.md").read_text()
    for name in FOLDERS | {"rclpy", "pybullet", "mujoco", "trimesh", "open3d"}:
        assert name in page, f"docs/architecture.md does not mention {name}"


def test_no_source_outside_the_package_is_too_long() -> None:
    others = [p for part in ("benchmark", "tests", "scripts") for p in (ROOT / part).rglob("*.py")]
    too_long = [str(p) for p in others if p.read_text().count("\n") > MAX_LINES]
    assert not too_long


@pytest.mark.parametrize(
    ("module", "source", "word"),
    [
        ("geometry/mesh.py", "from gpis_grasp_planner.plan import planner", "arrows"),
        ("geometry/mesh.py", "import gpis_grasp_planner.hand.drive as drive", "arrows"),
        ("geometry/mesh.py", "from ..surface.chart import Chart", "arrows"),
        ("geometry/mesh.py", "from .. import surface", "arrows"),
        ("surface/chart.py", "from gpis_grasp_planner.hand import drive", "arrows"),
        ("errors.py", "from gpis_grasp_planner.settings import describe", "arrows"),
        ("optimise/rprop.py", "from gpis_grasp_planner.geometry import mesh", "arrows"),
        ("quality/contacts.py", "from gpis_grasp_planner.optimise import rprop", "arrows"),
        (
            "search/dual.py",
            "def f():\n    from gpis_grasp_planner.scene import closing",
            "arrows",
        ),
        ("view/picture.py", "from gpis_grasp_planner.ros import node", "arrows"),
        ("surface/blend.py", "from numba import njit", "compiled.py"),
        ("search/dual.py", "import rclpy.node", "only ros/"),
        ("cli/main.py", "from geometry_msgs.msg import Pose", "only ros/"),
        ("cli/plan_all.py", "from distributed import Client", "batch/cluster.py"),
        ("scene/closing.py", "def f():\n    import pybullet as p", "bullet_world"),
        ("scene/closing.py", "import importlib\nimportlib.import_module('pybullet')", "bullet_"),
        ("surface/sampling.py", "import trimesh", "only others"),
        ("search/searches.py", "from gpis_grasp_benchmark import rivals", "only others"),
        ("cli/plan.py", "import matplotlib.pyplot as plt", "only view/"),
        ("ros/node.py", "from open3d import geometry", "only geometry/cloud"),
        ("utils/misc.py", "import numpy", "place"),
        ("quality/contacts.py", "x = 1\n" * (MAX_LINES + 1), "lines"),
    ],
)
def test_a_bad_module_is_found(module: str, source: str, word: str) -> None:
    [fault] = faults(source, module)
    assert fault.startswith(module)
    assert word in fault


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("scene/bullet_world.py", "import pybullet"),
        ("ros/node.py", "import rclpy\nfrom gpis_grasp_planner.plan.planner import GraspPlanner"),
        ("cli/plan.py", "from gpis_grasp_planner.view.picture import draw"),
        ("search/hpp_opt.py", "from gpis_grasp_planner.optimise.rprop import minimise"),
        ("surface/chart.py", "from .implicit_surface import ImplicitSurface\nimport numpy"),
        ("cli/main.py", "from gpis_grasp_planner import __version__"),
        ("hand/drive.py", "x = 1\n" * MAX_LINES),
    ],
)
def test_a_good_module_passes(module: str, source: str) -> None:
    assert faults(source, module) == []


def test_the_ros_packages_that_are_imported_are_those_of_the_package_xml() -> None:
    imported = {
        name.split(".")[0]
        for path in (PACKAGE / "ros").rglob("*.py")
        for name in imported_names(path.read_text(), f"ros/{path.name}")
    }
    others = {"gpis_grasp_planner", "numpy", "yaml"} | sys.stdlib_module_names
    others |= {"moveit_msgs"}  # for who has it: ros/exchange.py
    declared = {e.text or "" for e in ET.parse(PACKAGE.parent / "package.xml").iter("exec_depend")}
    libraries = {name for name in declared if name.startswith("python3-")}
    launch = {"launch", "launch_ros"}  # of launch/ alone
    assert imported - others == declared - libraries - launch
    # rosdep's keys of what setup.py lists, but for three that rosdep does not know
    [listed] = re.findall(
        r"install_requires=\[(.*?)\]", (PACKAGE.parent / "setup.py").read_text(), re.S
    )
    names = {name.lower().replace("pyyaml", "yaml") for name in re.findall(r'"(.+?)"', listed)}
    keys = {name.removeprefix("python3-").removesuffix("-pip") for name in libraries}
    assert keys == names - {"fast-simplification", "llvmlite", "threadpoolctl"}


def test_the_core_imports_without_ros_and_without_the_heavy_libraries() -> None:
    """Importing everything below the edge needs no ROS and loads neither Open3D nor Matplotlib."""
    core = [
        ".".join(["gpis_grasp_planner", *p.relative_to(PACKAGE).with_suffix("").parts])
        for p in package_modules()
        if folder_of(p.relative_to(PACKAGE).as_posix()) not in {"ros", "view", "batch", "cli"}
        and p.name not in {"__init__.py", "__main__.py", "warm_up.py"}
    ]
    program = f"""
import importlib, sys
sys.path.insert(0, {str(PACKAGE.parent)!r})
for absent in ("rclpy", "geometry_msgs", "gpis_grasp_msgs"):
    sys.modules[absent] = None
for name in {core!r}:
    importlib.import_module(name)
print(*sorted({{"open3d", "matplotlib"}} & set(sys.modules)))
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == []
