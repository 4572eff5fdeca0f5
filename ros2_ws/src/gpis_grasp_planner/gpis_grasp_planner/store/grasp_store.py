"""Plans kept on disk: several places for a part, bounded in size, never in the way of planning.

A plan that is put is on the disk when `put` returns True. Where the file cannot be used, planning
goes on without it and the log says so once for each cause.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from gpis_grasp_planner.errors import ErrorCode, GraspPlannerError, RequestError
from gpis_grasp_planner.geometry.mesh import TriangleMesh
from gpis_grasp_planner.geometry.part import Part
from gpis_grasp_planner.plan.request import PlanRequest, PlanResult
from gpis_grasp_planner.plan.store_settings import StoreSettings
from gpis_grasp_planner.store.conditions import Conditions, planner_version
from gpis_grasp_planner.store.database import Connection, Database, StoreFault
from gpis_grasp_planner.store.record import Record, unpack
from gpis_grasp_planner.surroundings.place import STAND_IN, Place
from gpis_grasp_planner.surroundings.similarity import same_place

ENVIRONMENT = "GPIS_GRASP_STORE"
# Answers that another search by the same settings would not change but by chance.
KEPT_CODES = (
    ErrorCode.SUCCESS,
    ErrorCode.NO_FEASIBLE_GRASP,
    ErrorCode.ALL_GRASPS_BLOCKED,
    ErrorCode.NO_GRASP_HOLDS,
)
_OFF = ("off", "0", "no")

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Entry:
    """One kept plan without its content; the columns of the table are its fields."""

    id: int
    key: str
    mesh_hash: str
    mesh_id: str
    hand: str
    planner_version: str
    place: str
    time_budget_s: float
    n_asked: int
    code: int
    n_grasps: int
    best_epsilon: float | None
    n_tried: int
    n_held: int
    made_s: float
    used_s: float
    n_bytes: int

    @property
    def usable(self) -> bool:
        """Whether the planner of now would make the plan by the same sources."""
        return self.planner_version == planner_version()

    def where(self) -> Place:
        """The place that the plan was made for."""
        data = json.loads(self.place)
        return Place() if data is None else Place.from_mapping(data, _stand_in)


@dataclass(frozen=True, eq=False)
class Kept:
    """A plan out of the store."""

    entry: Entry
    record: Record
    same_place: bool


_COLUMNS = [f.name for f in fields(Entry) if f.name != "n_bytes"]
_SELECT = f"SELECT {', '.join(_COLUMNS)}, length(content) FROM plans"
_INSERT = (
    f"INSERT INTO plans ({', '.join(_COLUMNS[1:])}, content, sha256) "
    f"VALUES ({', '.join('?' * (len(_COLUMNS) + 1))})"
)


class GraspStore:
    """The plans of one file.

    Parameters
    ----------
    path : Path
    most_bytes : int
        Of the contents of all plans together.
    wait_s : float [s]
        For another process that is writing.
    """

    _said: set[str] = set()  # noqa: RUF012  # one log line per cause and process

    def __init__(self, path: Path, most_bytes: int = 2_000_000_000, wait_s: float = 5.0) -> None:
        self.database = Database(path, wait_s)
        self.most_bytes = most_bytes
        self._uses: dict[int, float] = {}

    @classmethod
    def of(cls, settings: StoreSettings) -> GraspStore | None:
        """The store that settings and environment ask for; None where it is switched off."""
        path = store_path(settings)
        if path is None:
            return None
        return cls(path, 1_000_000 * settings.most_megabytes, settings.wait_s)

    def find(
        self,
        part: Part,
        conditions: Conditions,
        request: PlanRequest,
        place: Place,
        *,
        elsewhere: bool = True,
        failures: bool = False,
    ) -> Kept | None:
        """The plan to answer a request from: one for this place, else the latest for another.

        Only plans of at least the request's time budget and number of grasps are taken. That it was
        used is on the disk with the next :meth:`note_uses` or :meth:`put`. Some 5 ms.

        Parameters
        ----------
        part : Part
        conditions : Conditions
        request : PlanRequest
        place : Place
        elsewhere : bool
            Whether a plan for another place is any help.
        failures : bool
            Whether an answer without grasps is any help.
        """
        sql = (
            f"{_SELECT} WHERE key = ? AND time_budget_s >= ? AND n_asked >= ? ORDER BY made_s DESC"
        )
        wanted = (conditions.key, request.time_budget_s, request.n_grasps)
        try:
            with self.database.reading() as connection:
                rows = [_entry(row) for row in connection.execute(sql, wanted)]
                rows = [row for row in rows if failures or row.n_grasps]
                same = [e for e in rows if same_place(e.where(), place, part.max_radius)]
                for entry in [*same, *(rows if elsewhere else ())]:
                    try:
                        record = _content(connection, entry, late=True)
                    except GraspPlannerError as error:
                        self._say("a plan is damaged", error)
                        continue
                    break
                else:
                    return None
        except StoreFault as error:
            self._say("read", error)
            return None
        self._uses[entry.id] = time.time()
        result = replace(record.result, mesh_id=part.mesh_id)  # the same mesh by another name
        return Kept(entry, replace(record, result=result), entry in same)

    def put(self, record: Record) -> bool:
        """Keep a plan in place of a smaller or older one; whether it is on the disk."""
        try:
            with self.database.writing() as connection:
                self._write_uses(connection)
                self._put(connection, record, time.time())
        except StoreFault as error:
            self._say("written", error)
            return False
        return True

    def note_uses(self) -> None:
        """Write down which plans were found; 5 to 30 ms, for when the answer is out."""
        if not self._uses:
            return
        try:
            with self.database.writing() as connection:
                self._write_uses(connection)
        except StoreFault as error:  # one that is only read
            self._say("written", error)

    def put_all(self, records: Sequence[tuple[Record, float]]) -> None:
        """Keep plans with the times when they were made, all or none.

        Raises
        ------
        StoreFault
        """
        with self.database.writing() as connection:
            for record, made_s in records:
                self._put(connection, record, made_s)

    def entries(self) -> list[Entry]:
        """Everything that is kept, last used first.

        Raises
        ------
        StoreFault
        """
        with self.database.reading() as connection:
            return [_entry(r) for r in connection.execute(f"{_SELECT} ORDER BY used_s DESC, id")]

    def record(self, entry: Entry) -> Record:
        """The content of an entry.

        Raises
        ------
        RequestError
            INVALID_DOCUMENT where it is damaged or gone.
        StoreFault
        """
        with self.database.reading() as connection:
            return _content(connection, entry)

    def records(self) -> Iterator[tuple[Entry, Record | GraspPlannerError]]:
        """Every entry with its content, or with what is wrong with it."""
        for entry in self.entries():
            try:
                yield entry, self.record(entry)
            except RequestError as error:
                yield entry, error

    def remove(self, entries: Sequence[Entry]) -> None:
        """Forget plans, and give their room back.

        Raises
        ------
        StoreFault
        """
        with self.database.writing() as connection:
            connection.executemany("DELETE FROM plans WHERE id = ?", [(e.id,) for e in entries])
        self.database.compact()

    def _put(self, connection: Connection, record: Record, made_s: float) -> None:
        result, conditions = record.result, record.conditions
        content = record.packed()
        entry = _entry_of(result, conditions, made_s, len(content))
        place = entry.where()
        old = connection.execute(f"{_SELECT} WHERE key = ?", (entry.key,)).fetchall()
        for other in map(_entry, old):
            smaller = other.time_budget_s <= entry.time_budget_s and other.n_asked <= entry.n_asked
            if smaller and same_place(other.where(), place, result.torque_scale):
                connection.execute("DELETE FROM plans WHERE id = ?", (other.id,))
        values = [getattr(entry, name) for name in _COLUMNS[1:]]
        connection.execute(_INSERT, (*values, content, hashlib.sha256(content).hexdigest()))
        self._trim(connection)

    def _trim(self, connection: Connection) -> None:
        # The contents are less than the pages in use; to add them up takes a look at every plan.
        pages, free, size = (
            int(connection.execute(f"PRAGMA {what}").fetchone()[0])
            for what in ("page_count", "freelist_count", "page_size")
        )
        if (pages - free) * size <= self.most_bytes:
            return
        sql = "SELECT id, length(content) FROM plans ORDER BY used_s"
        sizes = connection.execute(sql).fetchall()
        total = sum(size for _, size in sizes)
        for number, size in sizes[:-1]:
            if total <= self.most_bytes:
                return
            connection.execute("DELETE FROM plans WHERE id = ?", (number,))
            total -= size

    def _write_uses(self, connection: Connection) -> None:
        uses = [(used_s, number) for number, used_s in self._uses.items()]
        self._uses.clear()
        connection.executemany("UPDATE plans SET used_s = ? WHERE id = ?", uses)

    def _say(self, what: str, why: object) -> None:
        if what not in GraspStore._said:
            GraspStore._said.add(what)
            _log.warning("%s Planning goes on without it.", why)


def store_path(settings: StoreSettings) -> Path | None:
    """The file of the store; None where it is switched off or the user has no home."""
    if not settings.enabled:
        return None
    if settings.path:
        return Path(settings.path).expanduser()
    chosen = os.environ.get(ENVIRONMENT, "")
    if chosen:
        return None if chosen.lower() in _OFF else Path(chosen).expanduser()
    base = os.environ.get("XDG_DATA_HOME")
    try:
        data = Path(base) if base else Path.home() / ".local" / "share"
    except RuntimeError:
        return None
    return data / "gpis_grasp_planner" / "grasps.sqlite"


def _entry(row: Sequence[Any]) -> Entry:
    return Entry(*row)


def _entry_of(result: PlanResult, conditions: Conditions, made_s: float, n_bytes: int) -> Entry:
    grasps = result.grasps
    return Entry(
        id=0,
        key=conditions.key,
        mesh_hash=result.mesh_hash,
        mesh_id=result.mesh_id,
        hand=result.hand,
        planner_version=str(conditions.as_mapping()["planner_version"]),
        place=json.dumps(result.place, sort_keys=True),
        time_budget_s=result.request.time_budget_s,
        n_asked=result.request.n_grasps,
        code=int(result.code),
        n_grasps=len(grasps),
        best_epsilon=max((grasp.epsilon for grasp in grasps), default=None),
        n_tried=sum(grasp.trials is not None for grasp in grasps),
        n_held=sum(grasp.trials is not None and grasp.trials.held for grasp in grasps),
        made_s=made_s,
        used_s=time.time(),
        n_bytes=n_bytes,
    )


def _content(connection: Connection, entry: Entry, *, late: bool = False) -> Record:
    name = f"Plan {entry.id} of the grasp store"
    sql = "SELECT content, sha256 FROM plans WHERE id = ?"
    row = connection.execute(sql, (entry.id,)).fetchone()
    if row is None or hashlib.sha256(row[0]).hexdigest() != row[1]:
        raise RequestError(
            f"{name} is {'gone' if row is None else 'damaged'}. Plan '{entry.mesh_id}' anew.",
            ErrorCode.INVALID_DOCUMENT,
        )
    record = unpack(row[0], name, late=late)
    if record.conditions.key != entry.key or record.result.mesh_hash != entry.mesh_hash:
        raise RequestError(
            f"{name} is another plan than its entry says. Plan '{entry.mesh_id}' anew.",
            ErrorCode.INVALID_DOCUMENT,
        )
    return record


def _stand_in(_: str) -> TriangleMesh:
    return STAND_IN
