"""What the audit says of what pip-audit found, above all where it found nothing out."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/audit.py"


@pytest.fixture(scope="module")
def audit() -> ModuleType:
    spec = importlib.util.spec_from_file_location("audit", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def packages(n_good: int, n_skipped: int, n_bad: int = 0) -> list[dict[str, object]]:
    found = {"id": "PYSEC-1", "fix_versions": ["2.0"]}
    return [
        *({"name": f"good{i}", "version": "1", "vulns": []} for i in range(n_good)),
        *({"name": f"ros{i}", "skip_reason": "not found"} for i in range(n_skipped)),
        *({"name": f"bad{i}", "version": "1", "vulns": [found]} for i in range(n_bad)),
    ]


@pytest.mark.parametrize(
    ("counts", "code", "said"),
    [
        ((10, 3), 0, "13 locked packages: 10 looked up, 0 with advisories"),
        ((3, 10), 2, "nothing is known"),
        ((3, 10, 1), 1, "bad0 1: PYSEC-1, mended in 2.0"),
    ],
)
def test_what_is_said(
    audit: ModuleType,
    capsys: pytest.CaptureFixture[str],
    counts: tuple[int, ...],
    code: int,
    said: str,
) -> None:
    assert audit.report(packages(*counts)) == code
    assert said in capsys.readouterr().out
