"""Where compiled functions are kept: one folder per state of the package's compiled sources.

A compiled function has the functions that it calls inside: after an edit or an upgrade of a callee,
code kept by the file of the caller alone would be stale. A folder named by a hash over all sources
that compile anything cannot be.

Folders are looked through in this order: beside the package, then in the user's cache; or
``NUMBA_CACHE_DIR`` alone where that is set. One that can only be read (an installation by another
user, a container's image) is read all the same; what is missing goes into the next that can be
written, and nowhere where there is none.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from gpis_grasp_planner.whole_file import replace_file

_PREFIX = "compiled-"
_MARK = b"gpis_grasp_planner.compiled import"


@functools.cache
def sources_hash() -> str:
    """Hash over the contents of all modules that compile anything, and of what compiles them."""
    digest = hashlib.sha256()
    here = Path(__file__).parent
    for path in sorted(here.rglob("*.py")):
        source = path.read_bytes()
        if _MARK in source or path == here / "compiled.py":
            digest.update(path.name.encode())
            digest.update(source)
    return digest.hexdigest()[:16]


def folders() -> tuple[Path, ...]:
    """Folders that may hold compiled functions, in the order in which they are read and written."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return (Path(chosen) / (_PREFIX + sources_hash()),)
    return tuple(root / (_PREFIX + sources_hash()) for root in _roots())


def contents(name: str) -> Iterator[bytes]:
    """Contents of the files of a name, in the order of the folders; none that cannot be read."""
    for folder in folders():
        with contextlib.suppress(OSError):
            yield (folder / name).read_bytes()


def write_kept(name: str, content: bytes) -> OSError | None:
    """Write a file into the first folder that takes it; the last error where none does."""
    error: OSError | None = None
    for folder in folders():
        try:
            replace_file(folder / name, content)
        except OSError as failed:
            error = failed
        else:
            return None
    return error


def remove_stale_caches() -> None:
    """Remove the folders of earlier states."""
    current = _PREFIX + sources_hash()
    for root in _roots():
        for prefix in (_PREFIX, "numba-"):
            for folder in root.glob(prefix + "*"):
                if folder.name != current:
                    shutil.rmtree(folder, ignore_errors=True)


def user_cache() -> Path | None:
    """Folder of this project in the user's cache; None for a user without a home."""
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "gpis_grasp_planner"
    except RuntimeError:
        return None


def _roots() -> list[Path]:
    own = user_cache()
    return [Path(__file__).parent / "__pycache__", *([] if own is None else [own])]
