"""pip's index settings reach uv."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/uv_settings.py"
spec = importlib.util.spec_from_file_location("uv_settings", SCRIPT)
assert spec is not None
assert spec.loader is not None
uv_settings = importlib.util.module_from_spec(spec)
spec.loader.exec_module(uv_settings)


def test_later_sections_win_and_lists_are_split() -> None:
    listing = "\n".join(
        [
            ":env:.index-url='https://three.example/simple'",
            "global.index-url='https://one.example/simple'",
            "install.index-url='https://two.example/simple'",
            "global.extra-index-url='https://a.example/simple\\nfile:///b/simple'",
            "global.timeout='60'",
        ]
    )
    assert uv_settings.pip_options(listing) == {
        "index-url": ["https://three.example/simple"],
        "extra-index-url": ["https://a.example/simple", "file:///b/simple"],
    }


def test_variables_of_uv(tmp_path: Path) -> None:
    options = {
        "index-url": ["https://one.example/simple"],
        "extra-index-url": ["https://a.example/simple", "file:///b/simple"],
        "find-links": [str(tmp_path), str(tmp_path / "absent"), "https://c.example/wheels"],
        "cert": ["/ca.pem"],
    }
    assert uv_settings.uv_variables(options) == {
        "UV_DEFAULT_INDEX": "https://one.example/simple",
        "UV_INDEX": "https://a.example/simple file:///b/simple",
        "UV_INDEX_STRATEGY": "unsafe-best-match",
        "UV_FIND_LINKS": f"{tmp_path},https://c.example/wheels",
        "SSL_CERT_FILE": "/ca.pem",
    }
    assert uv_settings.uv_variables({"find-links": [str(tmp_path / "absent")]}) == {}


def test_real_pip_configuration(tmp_path: Path) -> None:
    """A pip.conf as users write it, read by the real pip; variables of uv that are set win."""
    (tmp_path / "pip.conf").write_text(
        "[global]\nindex-url = https://one.example/it's here\nextra-index-url =\n"
        "    https://a.example/simple\n    https://b.example/simple\n"
    )
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("PIP_", "UV_", "SSL_"))}
    run = subprocess.run(
        [sys.executable, str(SCRIPT)],
        capture_output=True,
        text=True,
        check=True,
        env=inherited
        | {"PIP_CONFIG_FILE": str(tmp_path / "pip.conf"), "UV_DEFAULT_INDEX": "https://mine"},
    )
    assert "export UV_INDEX='https://a.example/simple https://b.example/simple'" in run.stdout
    assert "UV_DEFAULT_INDEX" not in run.stdout
