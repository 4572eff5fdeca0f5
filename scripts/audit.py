"""Known vulnerabilities of the locked dependencies, by pip-audit; says how many it could look up.

    make audit

Needs a network with PyPI's advisories. Exit code 0: none known; 1: some; 2: nothing is known, for
most packages could not be looked up. Packages of ROS are not on PyPI and are listed as such.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

PIP_AUDIT = "pip-audit==2.10.1"
LOCKS = ("installer.lock", "requirements.lock")
LEAST_SHARE = 0.5  # of the packages; ROS has some 60 of 250


def audited(uv: str, locks: list[Path]) -> list[dict[str, object]]:
    """What pip-audit says of each package."""
    command = [uv, "tool", "run", PIP_AUDIT, "--disable-pip", "--require-hashes", "-f", "json"]
    for lock in locks:
        command += ["-r", str(lock)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if not done.stdout.strip():
        sys.exit(f"pip-audit ended with {done.returncode} and said nothing.")
    return list(json.loads(done.stdout)["dependencies"])


def report(packages: list[dict[str, object]]) -> int:
    """Print what was found; the exit code."""
    skipped = [p for p in packages if "skip_reason" in p]
    bad = [p for p in packages if p.get("vulns")]
    for package in bad:
        for found in package["vulns"]:
            fixed = ", ".join(found["fix_versions"]) or "none yet"
            print(f"{package['name']} {package['version']}: {found['id']}, mended in {fixed}")
    n_looked_up = len(packages) - len(skipped)
    print(f"{len(packages)} locked packages: {n_looked_up} looked up, {len(bad)} with advisories,")
    print(f"{len(skipped)} not known there: {' '.join(sorted(str(p['name']) for p in skipped))}")
    if bad:
        return 1
    if n_looked_up < LEAST_SHARE * len(packages):
        print("Most could not be looked up, so that nothing is known. Is PyPI reachable?")
        return 2
    return 0


def main() -> int:
    """Audit the lock files of this repository."""
    root = Path(__file__).resolve().parents[1]
    uv = os.environ.get("UV", str(root / ".venv/bin/uv"))
    return report(audited(uv, [root / "requirements" / name for name in LOCKS]))


if __name__ == "__main__":
    sys.exit(main())
