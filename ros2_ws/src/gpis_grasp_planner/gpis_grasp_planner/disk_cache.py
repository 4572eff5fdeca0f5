"""Arrays that took long to make, kept on disk between processes; bounded in size.

A file is named by everything that its content depends on, so it is never stale. It appears as a
whole or not at all, and its checksum is looked at whenever it is read: a crash in the middle of a
write and two processes at a time do no harm, and a damaged file is set aside and made anew. A cache
that cannot be read or written costs time, nothing else; what was wrong is logged once.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gpis_grasp_planner.compiled_cache import user_cache
from gpis_grasp_planner.packed_arrays import pack, unpack
from gpis_grasp_planner.settings import SettingsGroup, setting
from gpis_grasp_planner.whole_file import replace_file

ENVIRONMENT = "GPIS_GRASP_CACHE"
_OFF = ("off", "0", "no")
_SUFFIX, _DAMAGED = ".arrays", ".damaged"
_LEFT_OVER_S = 3600.0

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class CacheSettings(SettingsGroup):
    """What was prepared for a mesh, on disk between processes."""

    directory: str = setting(
        "",
        description="Folder of the cache; empty: the environment's GPIS_GRASP_CACHE (a folder, or "
        "'off'), else 'objects' in the user's cache.",
    )
    most_megabytes: int = setting(
        500,
        low=0,
        high=1_000_000,
        description="Size beyond which what was not used for longest goes; 0 switches it off.",
    )


@dataclass(frozen=True)
class CacheEntry:
    """One file of the cache; `used_s` is when it was last read or written, since the epoch."""

    name: str
    kind: str
    n_bytes: int
    used_s: float


class DiskCache:
    """A folder of packed arrays.

    Parameters
    ----------
    folder : Path or None
        None switches it off.
    most_bytes : int
        Of all files together.
    """

    _said: set[str] = set()  # noqa: RUF012  # one log line per cause and process

    def __init__(self, folder: Path | None, most_bytes: int = 500_000_000):
        self.folder = folder if most_bytes > 0 else None
        self.most_bytes = most_bytes

    @classmethod
    def of(cls, settings: CacheSettings) -> DiskCache:
        """The cache that settings and environment ask for."""
        return cls(_folder(settings), 1_000_000 * settings.most_megabytes)

    def get(self, kind: str, key: str) -> dict[str, NDArray[Any]] | None:
        """Arrays by name, which may be written to; None where there are none (5 ms per 10 MB)."""
        if self.folder is None:
            return None
        path = self._path(kind, key)
        try:
            content = bytearray(path.stat().st_size)
            with path.open("rb") as file:
                file.readinto(content)
            arrays = unpack(content)
        except FileNotFoundError:
            return None
        except OSError as error:
            self._say("read", error)
            return None
        except ValueError as error:
            self._say("damaged", f"{path.name}: {error}; it is set aside and made anew")
            with contextlib.suppress(OSError):
                path.replace(path.with_suffix(_DAMAGED))
            return None
        with contextlib.suppress(OSError):
            os.utime(path)
        return arrays

    def put(self, kind: str, key: str, arrays: Mapping[str, Any]) -> None:
        """Keep arrays, where that is possible, and drop the oldest where it is too much."""
        if self.folder is None:
            return
        content = pack(arrays)
        if len(content) > self.most_bytes:
            return
        try:
            replace_file(self._path(kind, key), content)
            self._trim()
        except OSError as error:
            self._say("written", error)

    def entries(self) -> list[CacheEntry]:
        """Everything that is kept, last used first."""
        found = [
            CacheEntry(path.name, path.name.split("-")[0], size, used)
            for path, size, used in self._files()
            if path.suffix == _SUFFIX
        ]
        return sorted(found, key=lambda entry: -entry.used_s)

    def clear(self) -> int:
        """Remove all files of the cache, damaged and half-written ones as well; their bytes.

        Raises
        ------
        OSError
            Where a file cannot be removed.
        """
        total = 0
        for path, size, _ in self._files():
            path.unlink(missing_ok=True)
            total += size
        return total

    def _path(self, kind: str, key: str) -> Path:
        assert self.folder is not None
        return self.folder / f"{kind}-{hashlib.sha256(key.encode()).hexdigest()[:32]}{_SUFFIX}"

    def _files(self) -> list[tuple[Path, int, float]]:
        found = []
        for path in [] if self.folder is None else self.folder.glob("*"):
            # Nobody's other files go, should the setting name a folder with other things in it.
            if _SUFFIX in path.name or path.suffix == _DAMAGED:
                with contextlib.suppress(OSError):  # another process may have removed it
                    status = path.stat()
                    found.append((path, status.st_size, status.st_mtime))
        return found

    def _trim(self) -> None:
        files = sorted(self._files(), key=lambda file: -file[2])
        total = 0
        for path, size, used in files:
            total += size
            left_over = path.suffix != _SUFFIX and time.time() - used > _LEFT_OVER_S
            if total > self.most_bytes or left_over:
                path.unlink(missing_ok=True)
                total -= size

    def _say(self, what: str, why: object) -> None:
        if what not in DiskCache._said:
            DiskCache._said.add(what)
            _log.warning(
                "The cache '%s' is not as it should be (%s); planning goes on without it. "
                "`gpis-grasp cache` shows and clears it, %s=off switches it off.",
                self.folder,
                why,
                ENVIRONMENT,
            )


def _folder(settings: CacheSettings) -> Path | None:
    if settings.directory:
        return Path(settings.directory).expanduser()
    chosen = os.environ.get(ENVIRONMENT, "")
    if chosen.lower() in _OFF:
        return None
    own = user_cache()
    return Path(chosen) if chosen else own and own / "objects"


@functools.cache
def code_version(*folders: str) -> str:
    """Hash over the sources of folders (or modules) of the package and the version of NumPy."""
    digest = hashlib.sha256(np.__version__.encode())
    here = Path(__file__).parent
    for folder in folders:
        path = here / folder
        for source in [path] if path.suffix == ".py" else sorted(path.rglob("*.py")):
            digest.update(source.relative_to(here).as_posix().encode())
            digest.update(source.read_bytes())
    return digest.hexdigest()[:32]
