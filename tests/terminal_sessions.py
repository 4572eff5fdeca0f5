"""A command in a terminal of a given width, as a person sees it; or in a pipe."""

from __future__ import annotations

import errno
import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from pathlib import Path

import gpis_grasp_planner

PACKAGE_ROOT = Path(gpis_grasp_planner.__file__).parents[1]
PROGRAM = (sys.executable, "-m", "gpis_grasp_planner.cli.main")
_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def environment(**changes: str) -> dict[str, str]:
    """That of the tests, with the sources to be tested and a terminal of the usual kind."""
    plain = {k: v for k, v in os.environ.items() if k not in ("COLUMNS", "LINES", "NO_COLOR")}
    return {**plain, "PYTHONPATH": str(PACKAGE_ROOT), "TERM": "xterm-256color", **changes}


def in_terminal(columns: int, *arguments: object, **changes: str) -> tuple[int, str]:
    """Run a command with stdout in a terminal; its exit code and what stands on the screen.

    Colours are taken away; stderr is not part of it.
    """
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, columns, 0, 0))
    process = subprocess.Popen(
        [*PROGRAM, *map(str, arguments)],
        stdin=theirs,
        stdout=theirs,
        stderr=subprocess.DEVNULL,
        env=environment(**changes),
    )
    os.close(theirs)
    shown = bytearray()
    while True:
        try:
            some = os.read(ours, 65536)
        except OSError as end:  # Linux says so when the last process has closed the terminal
            if end.errno != errno.EIO:
                raise
            break
        if not some:
            break
        shown += some
    os.close(ours)
    text = _ESCAPES.sub("", shown.decode()).replace("\r\n", "\n")
    return process.wait(), text


def in_pipe(*arguments: object, **changes: str) -> subprocess.CompletedProcess[str]:
    """Run a command with its outputs in pipes."""
    return subprocess.run(
        [*PROGRAM, *map(str, arguments)],
        env=environment(**changes),
        text=True,
        capture_output=True,
        check=False,
    )
