"""What a benchmark prints, kept as a page with its command, version and machine."""

from __future__ import annotations

import contextlib
import io
import os
import shlex
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

ROOT = Path(__file__).resolve().parents[1]


def add_report_option(parser: ArgumentParser, page: str) -> None:
    """The option ``--report``, by default a page of docs/reliability."""
    parser.add_argument(
        "--report",
        type=Path,
        default=ROOT / "docs" / "reliability" / page,
        metavar="FILE",
        help=f"page to write (docs/reliability/{page}); /dev/null for none",
    )


@contextmanager
def report(page: Path, title: str) -> Iterator[None]:
    """What is printed inside goes to the page, too; a page that was there is replaced.

    It is written when the inside ends, also by an error, with what there is until then.

    Parameters
    ----------
    page : Path
    title : str
        Its heading.
    """
    both = _Both(sys.stdout)
    head = f"# {title}\n\n{_made_by()}\n\n"
    try:
        with contextlib.redirect_stdout(both):
            yield
    finally:
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(head + both.getvalue(), encoding="utf-8")


class _Both(io.StringIO):
    """Keeps what is written, and passes it on."""

    def __init__(self, other: TextIO) -> None:
        super().__init__()
        self._other = other

    def write(self, text: str) -> int:
        self._other.write(text)
        return super().write(text)

    def flush(self) -> None:
        self._other.flush()


def _made_by() -> str:
    """A sentence: the command, the commit, cores and their load before."""
    words = [f"tests/benchmarks/{Path(sys.argv[0]).name}", *sys.argv[1:]]
    commit = _git("rev-parse", "--short", "HEAD") or "unknown"
    changed = " with changes" if _git("status", "--porcelain", "--untracked-files=no") else ""
    cores, load = len(os.sched_getaffinity(0)), os.getloadavg()[0]
    return (
        f"`python {shlex.join(words)}` at commit {commit}{changed}, {cores} cores with a load of "
        f"{load:.1f} before."
    )


def _git(*words: str) -> str:
    try:
        done = subprocess.run(["git", "-C", ROOT, *words], capture_output=True, text=True)
    except FileNotFoundError:
        return ""
    return done.stdout.strip()
