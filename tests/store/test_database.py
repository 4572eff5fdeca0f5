"""Damaged, truncated, read-only, full, newer, older: planning goes on, and it is said."""

from __future__ import annotations

import logging
import os
import resource
import sqlite3

import pytest
from store_writers import record_of

from gpis_grasp_planner.forked_child import ForkedChild
from gpis_grasp_planner.store.database import MIGRATIONS, Database, StoreFault
from gpis_grasp_planner.store.grasp_store import GraspStore
from gpis_grasp_planner.store.record import Record


@pytest.fixture
def filled(store, box, plan):
    for seed in range(20):
        assert store.put(record_of(box, plan, seed=seed))
    return store.database.path


def damage_middle(path, rng):
    content = bytearray(path.read_bytes())
    half = len(content) // 2
    content[4096 : half + 4096] = rng.bytes(half)
    path.write_bytes(content)


def truncate(path, rng):
    os.truncate(path, path.stat().st_size // 2 - int(rng.integers(1, 4000)))


def no_database(path, rng):
    path.write_bytes(rng.bytes(10_000))


@pytest.mark.parametrize("harm", [damage_middle, truncate, no_database])
def test_a_damaged_file_is_set_aside_and_reported(filled, box, plan, rng, caplog, harm):
    harm(filled, rng)
    content = filled.read_bytes()
    with caplog.at_level(logging.WARNING):
        store = GraspStore(filled)
        assert store.put(record_of(box, plan, seed=99))
    [aside] = [
        p for p in filled.parent.glob("*.damaged-*") if p.suffix[-4:] not in ("-wal", "-shm")
    ]
    assert aside.read_bytes() == content
    assert aside.name in caplog.text
    assert [record.result.request.seed for _, record in store.records()] == [99]


def test_a_damaged_row_is_told_and_the_others_serve(filled, caplog):
    with sqlite3.connect(filled) as connection:
        connection.execute("UPDATE plans SET content = x'00112233' WHERE id = 3")
    store = GraspStore(filled)
    bad = [entry.id for entry, record in store.records() if not isinstance(record, Record)]
    assert bad == [3]


def test_a_file_that_only_may_be_read_answers(filled, box, plan):
    """As a user who owns neither file nor folder, where the tests run as root."""

    def serve(connection):
        if os.getuid() == 0:
            os.setuid(65534)
        store = GraspStore(filled)
        connection.send((store.put(record_of(box, plan, seed=50)), len(store.entries())))

    for folder in filled.parents:
        if folder.stat().st_uid == os.getuid() and folder != folder.parent:
            folder.chmod(folder.stat().st_mode | 0o055)
    filled.chmod(0o444)
    filled.parent.chmod(0o555)
    try:
        with ForkedChild(serve) as child:
            assert child.connection.recv() == (False, 20)
    finally:
        filled.parent.chmod(0o755)


def test_a_full_disk_is_no_matter(store, box, plan, caplog):
    """A limit on the size of files stands in for the disk's end: SQLite sees the same error."""

    def serve(connection):
        import signal

        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
        done = [store.put(record_of(box, plan, seed=seed)) for seed in range(20)]
        connection.send((done, store.database.faults(), len(store.entries())))

    with ForkedChild(serve) as child:
        done, faults, n = child.connection.recv()
    assert not all(done)
    assert faults == []
    assert n >= sum(done)


def test_a_newer_schema_is_left_alone(filled, box, plan):
    with sqlite3.connect(filled) as connection:
        connection.execute(f"PRAGMA user_version = {len(MIGRATIONS) + 1}")
    store = GraspStore(filled)
    assert not store.put(record_of(box, plan))
    with pytest.raises(StoreFault, match="schema version 2"):
        store.entries()
    assert not list(filled.parent.glob("*.damaged-*"))


def test_an_older_schema_is_brought_up_to_date_with_what_it_holds(filled):
    later = Database(filled, migrations=(*MIGRATIONS, "ALTER TABLE plans ADD COLUMN extra TEXT;"))
    with later.reading() as connection:
        assert connection.execute("SELECT count(extra), count(*) FROM plans").fetchone() == (0, 20)
        assert connection.execute("PRAGMA user_version").fetchone() == (2,)


def test_a_migration_that_fails_changes_nothing(filled):
    broken = Database(filled, migrations=(*MIGRATIONS, "CREATE TABLE more (x);\nNONSENSE;"))
    with pytest.raises(StoreFault, match="NONSENSE"), broken.reading():
        pass
    assert len(GraspStore(filled).entries()) == 20


def test_a_file_that_is_not_there_is_empty_and_not_made_by_reading(store):
    assert store.entries() == []
    assert not store.database.path.exists()


def test_a_folder_in_its_place_is_a_fault_with_a_way_out(tmp_path):
    (tmp_path / "grasps.sqlite").mkdir()
    with pytest.raises(StoreFault, match="GPIS_GRASP_STORE=off"):
        GraspStore(tmp_path / "grasps.sqlite").entries()


def test_a_pipe_in_its_place_is_a_fault_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "grasps.sqlite")
    with pytest.raises(StoreFault, match="no regular file"):
        GraspStore(tmp_path / "grasps.sqlite").entries()
