"""A folder from elsewhere: to read it or to run in it deletes, overwrites and kills nothing of the user's."""

import contextlib
import errno
import os
import re
import shutil
import sqlite3
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from midnet_bench.campaign import store as database
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.store import open_or_create, open_store
from midnet_bench.errors import InputError
from tests.campaign.test_campaign_survival import FORTY, run_here
from tests.stores import labyrinth_store

DEFINITION = Definition("labyrinth", 1, 2, {"intruders": [1], "robots": [1]}, {})
MAGIC = bytes.fromhex("d9d505f920a163d7")


@pytest.fixture
def store(tmp_path: Path) -> Path:
    path = tmp_path / "campaign.sqlite"
    labyrinth_store(path, lambda intruders, robots, seed: 1, seeds=2, grid=DEFINITION.grid).close()
    return path


@pytest.fixture
def victim(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A file of the user's, which nothing may touch."""
    path = tmp_path_factory.mktemp("home") / "thesis.txt"
    path.write_text("years of work")
    yield path
    assert path.read_text() == "years of work"


def lay_hot_journal(database_file: Path, super_journal: Path) -> None:
    """A journal that SQLite takes back, and whose last record names a file that it then deletes."""
    page, size = 4096, database_file.stat().st_size
    header = MAGIC + struct.pack(">5I", 0, 1, size // page, 512, page)
    name = os.fsencode(super_journal)
    record = struct.pack(">I", 0x40000000 // page + 1) + name
    record += struct.pack(">2I", len(name), sum(name)) + MAGIC
    Path(f"{database_file}-journal").write_bytes(header.ljust(512, b"\0") + record)


def test_a_journal_that_names_another_file_deletes_nothing(store: Path, victim: Path) -> None:
    for attempt in (lambda: open_store(store), lambda: open_or_create(store, DEFINITION)):
        lay_hot_journal(store, victim)
        with pytest.raises(InputError, match="sqlite-journal"):
            attempt()
        assert victim.exists()


def test_what_a_killed_process_left_half_made_is_read_in_a_copy(store: Path, tmp_path: Path) -> None:
    killed = tmp_path / "killed" / store.name
    killed.parent.mkdir()
    with contextlib.closing(sqlite3.connect(store, isolation_level=None)) as writer:
        writer.execute("PRAGMA cache_size = 1")  # so that half of the transaction reaches the file
        writer.execute("BEGIN IMMEDIATE")
        writer.execute("UPDATE cells SET parameters = zeroblob(100000)")
        writer.execute("DELETE FROM trials")
        for ending in ("", "-journal"):
            shutil.copy(f"{store}{ending}", f"{killed}{ending}")
        writer.execute("ROLLBACK")
    assert killed.read_bytes() != store.read_bytes()
    before = contents(killed.parent)

    with open_store(store) as whole, open_store(killed) as half:
        assert {one.trial_id for one in half.trials()} == {one.trial_id for one in whole.trials()}
        assert half.counts() == (2, 0)
    assert contents(killed.parent) == before


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {one.name: (one.read_bytes(), one.stat().st_mtime_ns) for one in folder.iterdir()}


def test_a_reader_writes_nothing(store: Path) -> None:
    before = contents(store.parent)
    with open_store(store) as opened:
        assert opened.counts() == (2, 0)
        with pytest.raises(InputError, match="readonly"):
            opened.forget([1])
    assert contents(store.parent) == before


def test_a_campaign_that_runs_is_read_without_waiting(store: Path) -> None:
    with open_or_create(store, DEFINITION) as writer, open_store(store) as reader:
        with writer._transaction():
            writer._connection.execute("DELETE FROM trials")
            assert reader.counts() == (2, 0)
        assert reader.counts() == (0, 0)


def test_a_store_of_another_journal_mode_is_none_of_ours(store: Path) -> None:
    with contextlib.closing(sqlite3.connect(store)) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
    before = contents(store.parent)
    for attempt in (lambda: open_store(store), lambda: open_or_create(store, DEFINITION)):
        with pytest.raises(InputError, match="sqlite: "):
            attempt()
    assert contents(store.parent) == before


@pytest.mark.parametrize("name", ["campaign.sqlite", "campaign.sqlite-journal", ".campaign.lock"])
def test_no_file_of_a_run_is_written_through_a_link(name: str, tmp_path: Path, victim: Path) -> None:
    (tmp_path / name).symlink_to(victim)
    with pytest.raises(InputError, match=re.escape(name)):
        run_here(tmp_path, FORTY)


def test_a_lock_that_is_no_lock_is_refused(tmp_path: Path, store: Path, victim: Path) -> None:
    lock = store.rename(tmp_path / ".campaign.lock")
    lay_hot_journal(lock, victim)
    with pytest.raises(InputError, match="lock"), database.only_writer(tmp_path):
        pass
    assert victim.exists()


def test_a_file_system_without_locks_is_called_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    with database.only_writer(tmp_path):
        with pytest.raises(InputError, match="another midnet-bench"), database.only_writer(tmp_path):
            pass
        monkeypatch.setattr("fcntl.lockf", refuse)
        with pytest.raises(InputError, match="No locks available"), database.only_writer(tmp_path):
            pass


@pytest.mark.parametrize(
    "planted",
    [
        "CREATE VIEW more AS WITH RECURSIVE r(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM r) SELECT x FROM r",
        "CREATE TRIGGER more AFTER INSERT ON trials BEGIN DELETE FROM trials; END",
    ],
)
def test_a_store_that_would_compute_is_refused(planted: str, store: Path) -> None:
    with contextlib.closing(sqlite3.connect(store)) as connection:
        connection.execute(planted)
        connection.commit()
    for is_writer in (False, True):
        with pytest.raises(InputError, match=r"view|trigger"):
            open_store(store, is_writer)
