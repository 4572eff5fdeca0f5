"""A former version of this repository beside the present one, each in processes of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
OUT = ROOT / "out" / "bench"
FORMER = "61fc508"  # release 0.2.0


def former_tree(revision: str) -> Path:
    """A work tree of a revision in out/bench, made where it is not there yet."""
    tree = OUT / revision
    if not (tree / "ros2_ws").is_dir():
        OUT.mkdir(parents=True, exist_ok=True)
        subprocess.run(["git", "worktree", "prune"], cwd=ROOT, check=True)
        command = ["git", "worktree", "add", "--detach", str(tree), revision]
        subprocess.run(command, cwd=ROOT, check=True)
    return tree


def sources(tree: Path) -> Path:
    """Where a tree's package lies."""
    return tree / "ros2_ws" / "src" / "gpis_grasp_planner"


def environment(tree: Path) -> dict[str, str]:
    """The environment in which a tree's package is found first, with one thread and no store."""
    path = os.pathsep.join([str(sources(tree)), os.environ.get("PYTHONPATH", "")])
    alone = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    return {**os.environ, **alone, "PYTHONPATH": path, "GPIS_GRASP_STORE": "off"}


class Server:
    """A program of this folder that answers, with a tree's sources, a line for every line."""

    def __init__(self, tree: Path, program: str):
        self._process = subprocess.Popen(
            [sys.executable, program, "--serve"],
            env=environment(tree),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def asked(self, line: str) -> str:
        """The answer to a line."""
        print(line, file=self._process.stdin, flush=True)
        said = self._process.stdout.readline().strip()
        if not said:
            sys.exit(f"A process ended with code {self._process.wait()}; its message is above.")
        return said

    def close(self) -> None:
        """End the process."""
        self._process.stdin.close()
        self._process.wait()
