"""A benchmark's page: all that was printed, under the command, also where it ended by an error."""

from __future__ import annotations

import sys
from argparse import ArgumentParser
from pathlib import Path

import pytest
from benchmark_report import add_report_option, report


def test_what_is_printed_is_printed_and_kept_in_place_of_an_earlier_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "new" / "soak.md"
    monkeypatch.setattr(sys, "argv", ["/somewhere/node_soak.py", "--only", "a b"])
    for text in ("| first |", "| second, µ |"):
        with report(page, "Soak"):
            print(text, flush=True)
    print("after")
    assert capsys.readouterr().out == "| first |\n| second, µ |\nafter\n"
    lines = page.read_text(encoding="utf-8").splitlines()
    assert lines[0] == "# Soak"
    assert lines[2].startswith("`python tests/benchmarks/node_soak.py --only 'a b'` at commit ")
    assert "/somewhere" not in lines[2]
    assert lines[3:] == ["", "| second, µ |"]


def test_after_an_error_the_page_has_what_there_was(tmp_path: Path) -> None:
    def fail() -> None:
        with report(tmp_path / "page.md", "Title"):
            print("so far")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert (tmp_path / "page.md").read_text().endswith("\n\nso far\n")


def test_the_option_names_a_page_of_the_docs_unless_told_otherwise() -> None:
    parser = ArgumentParser()
    add_report_option(parser, "soak.md")
    default = parser.parse_args([]).report
    assert default.relative_to(Path(__file__).parents[1]) == Path("docs/reliability/soak.md")
    assert parser.parse_args(["--report", "other.md"]).report == Path("other.md")
