"""README's Python, taken from the page as it is, plans."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

README = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")


def test_the_first_snippet_is_short_and_prints_grasps(capsys: pytest.CaptureFixture[str]) -> None:
    [snippet] = re.findall(r"^```python\n(.*?)^```$", README, flags=re.MULTILINE | re.DOTALL)
    assert len(snippet.splitlines()) <= 14
    names: dict[str, object] = {"__name__": "readme"}
    assert "time_budget_s=10.0" in snippet
    # on a busy machine as well
    longer = snippet.replace("time_budget_s=10.0", "time_budget_s=20.0")
    exec(compile(longer, "README.md", "exec"), names)
    first, *rows = capsys.readouterr().out.splitlines()
    assert first.startswith("SUCCESS ")
    assert rows
    assert all(re.fullmatch(r"[0-9.e-]+ (True|False)", row) for row in rows)


def test_the_first_result_is_on_the_first_screen() -> None:
    lines = README.splitlines()
    assert (
        lines.index(
            "    gpis-grasp plan mug --support lowest --json grasps.json --picture grasp.png"
        )
        < 20
    )
