"""Print pip's index settings as environment variables of uv, as shell exports.

uv does not read pip's configuration. A user whose pip is told where to find packages (a mirror, a
local folder, a certificate) has said it once, and that must do. Variables of uv that are set
already win.
"""

from __future__ import annotations

import ast
import os
import shlex
import subprocess
import sys
from pathlib import Path

# pip's option -> uv's variable, and what joins several values.
VARIABLES = {
    "index-url": ("UV_DEFAULT_INDEX", " "),
    "extra-index-url": ("UV_INDEX", " "),
    "find-links": ("UV_FIND_LINKS", ","),
    "trusted-host": ("UV_INSECURE_HOST", " "),
    "cert": ("SSL_CERT_FILE", " "),
    "no-index": ("UV_NO_INDEX", " "),
}
# pip: a later section overrides an earlier one.
SECTIONS = ("global", "install", ":env:")


def pip_options(listing: str) -> dict[str, list[str]]:
    """Read the output of ``pip config list``: option -> its values."""
    found: dict[str, list[str]] = {}
    rows = [line.split("=", 1) for line in listing.splitlines() if "=" in line]
    for section in SECTIONS:
        for key, value in rows:
            name, _, option = key.rpartition(".")
            if name == section and option in VARIABLES:
                found[option] = ast.literal_eval(value).split()
    return found


def uv_variables(options: dict[str, list[str]]) -> dict[str, str]:
    """Translate pip's options; folders that do not exist are left out, as pip passes them over."""
    variables = {}
    for option, values in options.items():
        variable, separator = VARIABLES[option]
        kept = [v for v in values if option != "find-links" or "://" in v or Path(v).is_dir()]
        if kept:
            variables[variable] = separator.join(kept)
    if "UV_INDEX" in variables:
        # As pip does it; the lock's hashes decide which file is the right one.
        variables["UV_INDEX_STRATEGY"] = "unsafe-best-match"
    return variables


def main() -> None:
    """Print the exports that are not set already."""
    listing = subprocess.run(
        [sys.executable, "-m", "pip", "config", "list"], capture_output=True, text=True, check=True
    ).stdout
    for name, value in uv_variables(pip_options(listing)).items():
        if name not in os.environ:
            print(f"export {name}={shlex.quote(value)}")


if __name__ == "__main__":
    main()
