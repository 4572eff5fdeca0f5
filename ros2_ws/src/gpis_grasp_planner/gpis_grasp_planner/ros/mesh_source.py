"""Has the file behind a mesh ID changed? Answered without parsing it."""

from __future__ import annotations

import hashlib
import stat
from collections.abc import Sequence
from pathlib import Path

from gpis_grasp_planner.errors import RequestError


def fingerprint(directories: Sequence[Path], mesh_id: str, max_bytes: int) -> str | None:
    """SHA-256 (hex) over everything that may decide what an ID means; None if there is nothing.

    That is, in every directory of the catalogue: names and contents of the files whose name or
    stem is the ID or begins with it and a dot (mesh and sidecar). It is conservative: a file that
    the catalogue would not read changes the fingerprint, too.

    Parameters
    ----------
    directories : sequence of Path
    mesh_id : str
        Already checked against the catalogue's pattern.
    max_bytes : int
        Of larger files only size and times are looked at.

    Notes
    -----
    About 0.1 ms for a small mesh, 0.6 ms per megabyte.
    """
    digest = hashlib.sha256()
    found = False
    folder, _, leaf = mesh_id.rpartition("/")
    base = leaf.rpartition(".")[0] or leaf
    for directory in directories:
        try:
            inside = (directory / folder).iterdir()
            paths = sorted(p for p in inside if _belongs(p.name, leaf, base))
        except OSError:
            continue
        for path in paths:
            found = True
            digest.update(f"{path}\0{_content(path, max_bytes)}\0".encode())
    return digest.hexdigest() if found else None


def check_directories(directories: Sequence[Path]) -> None:
    """Refuse a catalogue one of whose directories is gone, without its path in the message.

    Raises
    ------
    RequestError
        INVALID_SETTING.
    """
    for number, directory in enumerate(directories, start=1):
        if not directory.is_dir():
            raise RequestError(
                f"Directory {number} of {len(directories)} of the mesh catalogue (parameter "
                "mesh_directories) does not exist or is no directory any more. Put it back, or "
                "start the node with another."
            )


def _belongs(name: str, mesh_id: str, base: str) -> bool:
    return name == mesh_id or name.startswith((f"{mesh_id}.", f"{base}."))


def _content(path: Path, max_bytes: int) -> str:
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            return "not a regular file"
        if status.st_size > max_bytes:
            return f"{status.st_size} {status.st_mtime_ns} {status.st_ctime_ns}"
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        return f"unreadable ({error.errno})"
