"""Where numba keeps compiled functions: one folder per state of the package's compiled sources.

Numba's on-disk cache looks only at the file of a function, not at the files of the functions it
calls: after an edit or an upgrade of a callee it would go on running the caller with the old callee
inlined. A folder named by a hash over all sources that compile anything cannot be stale.

`select_cache` must run before numba is imported; the package does it on import.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from pathlib import Path

_PREFIX = "numba-"


def select_cache() -> None:
    """Point numba to this package's cache, unless NUMBA_CACHE_DIR says otherwise. Some 5 ms."""
    os.environ.setdefault("NUMBA_CACHE_DIR", str(_root() / (_PREFIX + sources_hash())))


def sources_hash() -> str:
    """Hash over the contents of all modules that use numba."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        source = path.read_bytes()
        if b"from numba import" in source or b"import numba" in source:
            digest.update(path.name.encode())
            digest.update(source)
    return digest.hexdigest()[:16]


def remove_stale_caches() -> None:
    """Remove the folders of earlier states."""
    current = _PREFIX + sources_hash()
    for folder in _root().glob(_PREFIX + "*"):
        if folder.name != current:
            shutil.rmtree(folder, ignore_errors=True)


def _root() -> Path:
    """Beside the package where that can be written, else in the user's cache."""
    beside = Path(__file__).parent / "__pycache__"
    try:
        beside.mkdir(exist_ok=True)
        if os.access(beside, os.W_OK):
            return beside
    except OSError:
        pass
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "gpis_grasp_planner"
