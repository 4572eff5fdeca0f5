"""Every dotted name of the code that README and docs print is there, and every link leads on."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from gpis_grasp_planner.geometry.catalogue_settings import CatalogueSettings
from gpis_grasp_planner.plan.settings import setting_groups
from gpis_grasp_planner.settings import describe

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "ros2_ws/src/gpis_grasp_planner/gpis_grasp_planner"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = [page for page in PAGES if "benchmark" not in page.relative_to(ROOT).parts]
MODULES = {path.relative_to(PACKAGE).with_suffix("") for path in PACKAGE.rglob("*.py")}
FIRST = {part for module in MODULES for part in module.parts}
GROUPS = {**setting_groups(), "catalogue": CatalogueSettings}
SETTINGS = {f"{group}.{i.name}" for group, cls in GROUPS.items() for i in describe(cls)}
NO_CODE = ("py", "md", "json", "jsonl", "yaml", "png", "stl", "step", "html", "csv")


def names_of(text: str) -> list[str]:
    """Dotted names in backticks that begin with a folder or module, and imported names."""
    found = re.findall(r"`((?:[A-Za-z_]\w*\.)+[A-Za-z_]\w*)(?:\([^`]*\))?`", text)
    found = [name.removeprefix("gpis_grasp_planner.") for name in found]
    found = [n for n in found if n.split(".")[0] in FIRST and n.split(".")[-1] not in NO_CODE]
    for module, names in re.findall(
        r"^ *from gpis_grasp_planner\.([\w.]+) import ([\w, ]+)$", text, flags=re.MULTILINE
    ):
        found += [f"{module}.{name.strip()}" for name in names.split(",")]
    return sorted(set(found))


def members(body: list[ast.stmt]) -> dict[str, list[ast.stmt]]:
    """What a module or class defines, each with its own body."""
    defined: dict[str, list[ast.stmt]] = {}
    for node in body:
        match node:
            case ast.ClassDef() | ast.FunctionDef():
                defined[node.name] = node.body
            case ast.AnnAssign(target=ast.Name(id=name)):
                defined[name] = []
            case ast.Assign(targets=targets):
                defined |= {t.id: [] for t in targets if isinstance(t, ast.Name)}
    return defined


def leads_to(module: Path, rest: tuple[str, ...]) -> bool:
    """Whether a module defines the name that the rest spells."""
    body = ast.parse((PACKAGE / module).with_suffix(".py").read_text(encoding="utf-8")).body
    for name in rest:
        defined = members(body)
        if name not in defined:
            return False
        body = defined[name]
    return True


def exists(name: str) -> bool:
    """Whether code or a setting has this name; its first folders may be left out."""
    if name in SETTINGS:
        return True
    parts = tuple(name.split("."))
    for k in range(len(parts), 0, -1):
        if (PACKAGE / Path(*parts[:k])).is_dir() and k == len(parts):
            return True
        named = [m for m in MODULES if m.parts[-k:] == parts[:k]]
        if any(leads_to(module, parts[k:]) for module in named):
            return True
    return False


NAMES = [(page, name) for page in PAGES for name in names_of(page.read_text(encoding="utf-8"))]


def test_there_are_many() -> None:
    assert len(NAMES) > 60


@pytest.mark.parametrize(("page", "name"), NAMES, ids=lambda value: getattr(value, "name", value))
def test_a_name_exists(page: Path, name: str) -> None:
    assert exists(name), f"{page.name} names {name}"


def test_a_name_that_is_nowhere_is_found_out() -> None:
    assert names_of("`plan.planner.GraspPlanner.dream(part)` and `a.b`") == [
        "plan.planner.GraspPlanner.dream"
    ]
    assert not exists("plan.planner.GraspPlanner.dream")
    assert exists("plan.planner.GraspPlanner.answer")
    assert exists("planner.GraspPlanner.answer")
    assert exists("verification.processes")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files_and_headings(page: Path) -> None:
    for target in re.findall(r"\]\((?!https?:)([^)]+)\)", page.read_text(encoding="utf-8")):
        file, _, anchor = target.partition("#")
        path = (page.parent / file).resolve() if file else page
        assert path.exists(), target
        if anchor:
            text = path.read_text(encoding="utf-8")
            headings = re.findall(r"^#+ (.+)$", text, flags=re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}
            assert anchor in slugs, target
