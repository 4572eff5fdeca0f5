"""Files that are there as a whole or not at all, whatever ends a process."""

from __future__ import annotations

import contextlib
import uuid
from pathlib import Path


def replace_file(path: Path, content: bytes) -> None:
    """Write a file under another name and move it to its own; its folder is made where missing.

    Raises
    ------
    OSError
        Where it cannot be written (no space, no permission); nothing is left behind.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # Not by tempfile: no other user could read it, and root builds an image that all use.
    temporary = path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}")
    try:
        temporary.write_bytes(content)
        temporary.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise
