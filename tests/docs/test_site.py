"""What `make docs` gathers: every page has a place, and the references come from their sources."""

from __future__ import annotations

import importlib
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))
import docs_site  # noqa: E402

NAV = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("site") / "sources"
    docs_site.gather(made)
    return made


def test_every_page_but_reports_has_one_place(folder: Path) -> None:
    placed = re.findall(r"[\w./]+\.md$", NAV, flags=re.MULTILINE)
    assert len(placed) == len(set(placed))
    pages = {str(p.relative_to(folder)) for p in folder.rglob("*.md")}
    reports = {p for p in pages if p.startswith(("docs/benchmark/", "docs/reliability/"))}
    assert pages - reports <= set(placed) <= pages


def test_the_interfaces_are_all_there_as_they_are(folder: Path) -> None:
    page = (folder / "reference/interfaces.md").read_text(encoding="utf-8")
    sources = [
        p for kind in ("srv", "action", "msg") for p in (ROOT / docs_site.MESSAGES / kind).iterdir()
    ]
    assert len(sources) > 10
    for source in sources:
        assert source.read_text(encoding="utf-8").rstrip() in page


@pytest.mark.parametrize("name", [n for names in docs_site.PYTHON.values() for n in names])
def test_what_the_python_page_names_is_there_and_documented(name: str) -> None:
    module, _, member = f"gpis_grasp_planner.{name}".rpartition(".")
    found = importlib.import_module(f"{module}.{member}") if name == "errors" else None
    found = found or getattr(importlib.import_module(module), member)
    assert found.__doc__


def test_a_page_of_before_does_not_stay(folder: Path) -> None:
    (folder / "docs/gone.md").write_text("# Gone\n")
    docs_site.gather(folder)
    assert not (folder / "docs/gone.md").exists()
