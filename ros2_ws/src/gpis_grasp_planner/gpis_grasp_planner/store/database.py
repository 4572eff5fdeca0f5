"""The store's file: opened, checked, migrated, set aside where it is damaged.

SQLite with a write-ahead log and synchronous FULL: what was committed is there after a kill or a
power cut. Each use has a connection of its own, which costs a few milliseconds: no connection
passes a fork or a thread, and a file that another process has set aside is not written to.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import logging
import sqlite3
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from gpis_grasp_planner.errors import SystemFault

Connection = sqlite3.Connection

# One script for each version of the schema; none is ever changed, further ones are appended.
MIGRATIONS: tuple[str, ...] = (
    """
    CREATE TABLE plans (
        id INTEGER PRIMARY KEY,
        key TEXT NOT NULL,             -- conditions.Conditions.key
        mesh_hash TEXT NOT NULL,
        mesh_id TEXT NOT NULL,
        hand TEXT NOT NULL,
        planner_version TEXT NOT NULL,
        place TEXT NOT NULL,           -- surroundings.place.Place.as_mapping as JSON; null: free
        time_budget_s REAL NOT NULL,
        n_asked INTEGER NOT NULL,
        code INTEGER NOT NULL,
        n_grasps INTEGER NOT NULL,
        best_epsilon REAL,
        n_tried INTEGER NOT NULL,
        n_held INTEGER NOT NULL,
        made_s REAL NOT NULL,          -- since the epoch
        used_s REAL NOT NULL,
        content BLOB NOT NULL,         -- record.Record.packed
        sha256 TEXT NOT NULL           -- of the content
    );
    CREATE INDEX plans_by_key ON plans (key);
    CREATE INDEX plans_by_use ON plans (used_s);
    """,
)
_DAMAGED = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB}
_CANNOT = {
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_PERM,
    sqlite3.SQLITE_IOERR,
}
_BUSY = {sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED}
_PAUSE_S = 0.02

_log = logging.getLogger(__name__)


class StoreFault(SystemFault):
    """The store's file cannot be read or written."""


class Database:
    """One SQLite file.

    Parameters
    ----------
    path : Path
    wait_s : float [s]
        For another process that is writing.
    migrations : sequence of str
        Scripts from an empty file to the present schema.
    """

    def __init__(
        self, path: Path, wait_s: float = 5.0, migrations: Sequence[str] = MIGRATIONS
    ) -> None:
        self.path = path
        self.wait_s = wait_s
        self._migrations = migrations
        self._checked: int | None = None  # inode of the file that was found sound

    @contextlib.contextmanager
    def writing(self) -> Iterator[Connection]:
        """A transaction that has the file for itself; committed to the disk at the end.

        Raises
        ------
        StoreFault
            Where the file cannot be written: read-only, no space, another process all the time.
        """
        with self._translated():
            connection = self._opened()
            try:
                connection.execute("BEGIN IMMEDIATE")
                yield connection
                connection.execute("COMMIT")
            finally:
                connection.close()  # what was not committed is undone

    @contextlib.contextmanager
    def reading(self) -> Iterator[Connection]:
        """A connection for queries, also to a file that cannot be written.

        Raises
        ------
        StoreFault
        """
        with self._translated():
            connection = self._opened_to_read()
            try:
                yield connection
            finally:
                connection.close()

    def faults(self) -> list[str]:
        """What SQLite's full check finds; nothing for a sound file."""
        with self.reading() as connection:
            rows = [str(row[0]) for row in connection.execute("PRAGMA integrity_check")]
        return [] if rows == ["ok"] else rows

    def compact(self) -> None:
        """Give room that deleted plans had back to the disk."""
        with self._translated():
            connection = self._opened()
            try:
                connection.execute("VACUUM")
            finally:
                connection.close()

    def n_bytes(self) -> int:
        """Size on disk, with the log."""
        total = 0
        for end in ("", "-wal"):
            with contextlib.suppress(OSError):
                total += Path(f"{self.path}{end}").stat().st_size
        return total

    @contextlib.contextmanager
    def _translated(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            if _code(error) in _DAMAGED:
                self._set_aside(error)
            raise StoreFault(
                f"The grasp store {self.path} cannot be used ({error}). Free space or permissions "
                "may help; store.path names another file, GPIS_GRASP_STORE=off switches it off."
            ) from None
        except OSError as error:
            raise StoreFault(
                f"The grasp store {self.path} cannot be used ({error.strerror}). store.path names "
                "another file, GPIS_GRASP_STORE=off switches it off."
            ) from None

    def _opened_to_read(self) -> Connection:
        if not self.path.exists():
            return self._migrated(sqlite3.connect(":memory:", isolation_level=None))
        try:
            return self._opened()
        except sqlite3.OperationalError as error:
            if _code(error) not in _CANNOT:
                raise
        # A log beside it needs a folder that can be written; without one the file stands alone.
        last: sqlite3.Error | None = None
        for how in ("mode=ro", "immutable=1"):
            connection = sqlite3.connect(
                f"{self.path.resolve().as_uri()}?{how}", uri=True, timeout=self.wait_s
            )
            try:
                self._check(connection)
                self._check_version(connection)
            except sqlite3.OperationalError as error:
                connection.close()
                last = error
            else:
                return connection
        assert last is not None
        raise last

    def _opened(self) -> Connection:
        """A connection to the sound file of the present schema; a damaged one is set aside."""
        deadline = time.monotonic() + self.wait_s
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if self.path.exists() and not self.path.is_file() and not self.path.is_dir():
            # SQLite would wait for ever for the other end of a pipe.
            raise OSError(errno.EINVAL, "it is no regular file")
        while True:
            connection = sqlite3.connect(self.path, timeout=self.wait_s, isolation_level=None)
            try:
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute("PRAGMA synchronous = FULL")
                self._check(connection)
                return self._migrated(connection)
            except sqlite3.Error as error:
                connection.close()
                code = _code(error)
                if code in _DAMAGED:
                    self._set_aside(error)
                elif code not in _BUSY or time.monotonic() > deadline:
                    raise
                else:
                    time.sleep(_PAUSE_S)
            except BaseException:
                connection.close()
                raise

    def _check(self, connection: Connection) -> None:
        """Look the whole file through, the first time that this process opens it."""
        inode = self.path.stat().st_ino
        if self._checked == inode:
            return
        found = [str(row[0]) for row in connection.execute("PRAGMA quick_check(3)")]
        if found != ["ok"]:
            error = sqlite3.DatabaseError("; ".join(found))
            error.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
            raise error
        self._checked = inode

    def _check_version(self, connection: Connection) -> int:
        version = int(connection.execute("PRAGMA user_version").fetchone()[0])
        if version > len(self._migrations):
            raise StoreFault(
                f"The grasp store {self.path} has schema version {version}; this program knows "
                f"{len(self._migrations)}. Use the newer program, or another store.path."
            )
        return version

    def _migrated(self, connection: Connection) -> Connection:
        if self._check_version(connection) < len(self._migrations):
            connection.execute("BEGIN IMMEDIATE")
            # Another process may have done it while this one waited.
            for script in self._migrations[self._check_version(connection) :]:
                for statement in _statements(script):
                    connection.execute(statement)
            connection.execute(f"PRAGMA user_version = {len(self._migrations)}")
            connection.execute("COMMIT")
        return connection

    def _set_aside(self, why: sqlite3.Error) -> None:
        """Move a damaged file out of the way, unless another process has done so.

        Raises
        ------
        OSError
            Where the folder cannot be written.
        """
        with Path(f"{self.path}.lock").open("a") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if self._is_sound():
                return
            stamp = time.strftime("%Y%m%dT%H%M%S", time.gmtime())
            name = next(
                name
                for i in range(1000)
                if not (name := Path(f"{self.path}.damaged-{stamp}-{i}")).exists()
            )
            for end in ("", "-wal", "-shm"):
                with contextlib.suppress(FileNotFoundError):
                    Path(f"{self.path}{end}").rename(f"{name}{end}")
            self._checked = None
        _log.warning(
            "The grasp store %s is damaged (%s). It is set aside as %s and a new one is begun; "
            "what it held is planned anew.",
            self.path,
            why,
            name.name,
        )

    def _is_sound(self) -> bool:
        if not self.path.exists():
            return True
        connection = sqlite3.connect(self.path, timeout=self.wait_s)
        try:
            return connection.execute("PRAGMA quick_check(1)").fetchone()[0] == "ok"
        except sqlite3.DatabaseError as error:
            return _code(error) not in _DAMAGED
        finally:
            connection.close()


def _statements(script: str) -> Iterator[str]:
    """The statements of a script; `executescript` would commit before it."""
    text = ""
    for line in script.splitlines():
        text += line + "\n"
        if sqlite3.complete_statement(text):
            yield text
            text = ""


def _code(error: sqlite3.Error) -> int:
    return int(getattr(error, "sqlite_errorcode", 0) or 0) & 0xFF
