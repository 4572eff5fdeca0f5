"""SIGKILL processes that write into one grasp store, and count what is missing.

    PYTHONPATH=tests python tests/benchmarks/store_kills.py --kills 300

Each process stores plan after plan and says so for each that is on the disk; it is killed 0 to
50 ms after its first one. After each kill SQLite's full check is made; at the end every plan that
was acknowledged is read back. The exit code is 1 where anything is missing or damaged. It is a
kill of processes, not of the machine: that the disk does what fsync asks of it is not tried.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import trimesh
from planning_fixtures import make_part
from store_writers import killed_writers, small_plan


def main() -> int:
    """Run and print; 1 where an acknowledged plan is missing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    box = make_part("box", trimesh.creation.box((0.05, 0.06, 0.09)))
    plan = small_plan(box)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grasps.sqlite"
        rng = np.random.default_rng(arguments.seed)
        try:
            told, there = killed_writers(path, box, plan, arguments.kills, rng)
        except AssertionError as error:
            print(f"failed: {error}")
            return 1
        size = path.stat().st_size
    print(
        f"seed {arguments.seed}: {arguments.kills} kills, {told} plans acknowledged, all there "
        f"({there} in all), integrity clean after each kill; {size / 1e6:.1f} MB, "
        f"{time.monotonic() - began:.0f} s"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
