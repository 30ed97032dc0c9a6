"""The store: one SQLite file per campaign, one transaction per finished trial, one process that writes."""

import contextlib
import json
import sqlite3
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from midnet_bench.campaign import database
from midnet_bench.campaign.database import explained, transaction
from midnet_bench.campaign.definition import Definition, differences
from midnet_bench.campaign.provenance import Provenance, now_utc
from midnet_bench.campaign.trial import Row, Scalar, TrialSpec
from midnet_bench.campaign.worker import Outcome, decode_tables
from midnet_bench.errors import InputError

FILE_NAME = "campaign.sqlite"


@dataclass(frozen=True)
class StoredTrial:
    """One trial as the store keeps it."""

    store: Path
    trial_id: str
    seed: int
    parameters: dict[str, Scalar]
    status: str
    simulated_s: float | None
    wall_s: float
    traceback: str | None
    finished_utc: str
    payload: bytes | None

    @property
    def tables(self) -> dict[str, list[Row]]:
        """The tables of a finished trial. Raises InputError if they are damaged."""
        if self.payload is None:
            raise ValueError(f"trial {self.trial_id} has failed and has no tables")
        try:
            return decode_tables(self.payload)
        except ValueError as error:
            raise _damaged(self.store, self.trial_id, self.seed, "result") from error


class Store:
    """An open campaign store; a context manager. Made by :func:`open_store` and :func:`open_or_create`."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self.path = path
        self._connection = connection

    def __enter__(self) -> "Store":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, tb: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the file."""
        self._connection.close()

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        with explained(self.path), transaction(self._connection):
            yield

    @property
    def definition(self) -> Definition:
        """What the store was made for. Raises InputError if it does not say so any more."""
        with explained(self.path):
            row = self._connection.execute("SELECT definition FROM campaign").fetchone()
        try:
            return Definition.from_json(row[0] if row else "")
        except ValueError as error:
            raise InputError(
                f"{self.path}: damaged (which campaign it holds cannot be read);"
                " move it away, or --fresh to start over"
            ) from error

    def refuse_unless_extended_by(self, definition: Definition) -> None:
        """Raises InputError, naming what differs, unless ``definition`` only adds trials or grid values."""
        found = differences(self.definition, definition)
        if found:
            raise InputError(
                f"{self.path}: made by another campaign ({'; '.join(found)});"
                " give another folder with -o, or --fresh to start over"
            )

    def extend(self, definition: Definition) -> None:
        """Takes ``definition`` as the store's own. Raises as :meth:`refuse_unless_extended_by`."""
        self.refuse_unless_extended_by(definition)
        with self._transaction():
            self._connection.execute("UPDATE campaign SET definition = ?", (definition.to_json(),))

    def statuses(self) -> dict[str, str]:
        """Trial id -> ``finished`` or ``failed``."""
        with explained(self.path):
            return dict(self._connection.execute("SELECT trial_id, status FROM trials"))

    def failures(self) -> list[str]:
        """Of each failed trial the last line of its traceback: the exception and what it says."""
        with explained(self.path):
            rows = self._connection.execute("SELECT traceback FROM trials WHERE status = 'failed'").fetchall()
        return [text.splitlines()[-1] for (text,) in rows]

    def begin_run(self, provenance: Provenance) -> int:
        """Notes that a process begins to add trials; the run's id."""
        with self._transaction():
            text = json.dumps(provenance)
            cursor = self._connection.execute("INSERT INTO runs (provenance) VALUES (?)", (text,))
        assert cursor.lastrowid is not None
        return cursor.lastrowid

    def end_run(self, run_id: int) -> None:
        """Notes that the run came to its end by itself."""
        with self._transaction():
            self._connection.execute("UPDATE runs SET ended_utc = ? WHERE run_id = ?", (now_utc(), run_id))

    def runs(self) -> list[Provenance]:
        """The provenance of every run that added trials, in order, each with its ``ended_utc``.

        One that is damaged comes as its text under the key ``damaged``: it is no reason to lose the trials.
        """
        with explained(self.path):
            rows = self._connection.execute(
                "SELECT provenance, ended_utc FROM runs WHERE run_id IN (SELECT run_id FROM trials)"
                " ORDER BY run_id"
            ).fetchall()
        return [{**_provenance(text), "ended_utc": ended_utc} for text, ended_utc in rows]

    def record(self, run_id: int, spec: TrialSpec, outcome: Outcome) -> None:
        """Commits one trial, in place of an earlier failure of it."""
        with self._transaction():
            self._connection.execute(
                "INSERT OR REPLACE INTO trials VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (
                    spec.trial_id,
                    run_id,
                    spec.seed,
                    json.dumps(dict(spec.parameters)),
                    "finished" if outcome.payload is not None else "failed",
                    outcome.simulated_s,
                    outcome.wall_s,
                    outcome.failure,
                    now_utc(),
                    outcome.payload,
                ),
            )

    def trials(self) -> Iterator[StoredTrial]:
        """Every trial of the present definition, cell by cell in the grid's order, then by seed.

        Raises:
            InputError: a trial is damaged.
        """
        definition = self.definition
        with explained(self.path):
            rows = self._connection.execute("SELECT rowid, trial_id, seed, parameters FROM trials")
            places = sorted((self._place(definition, *identity), row_id) for row_id, *identity in rows)
            for _, row_id in places:
                row = self._connection.execute(
                    "SELECT trial_id, seed, parameters, status, simulated_s, wall_s, traceback,"
                    " finished_utc, result"
                    " FROM trials WHERE rowid = ?",
                    (row_id,),
                ).fetchone()
                yield StoredTrial(self.path, row[0], row[1], json.loads(row[2]), *row[3:])

    def _place(self, definition: Definition, trial_id: str, seed: int, text: str) -> tuple[list[int], int]:
        """Where a trial stands in the campaign's order. Raises InputError if what it ran is damaged."""
        try:
            parameters = json.loads(text)
            cell = definition.cell_of(parameters)
            place = [definition.grid[factor].index(value) for factor, value in cell.items()]
            if TrialSpec(definition.experiment, parameters, seed).trial_id != trial_id:
                raise ValueError("the id is a hash of the parameters and the seed, and not of these")
        except (KeyError, TypeError, ValueError) as error:
            raise _damaged(self.path, trial_id, seed, "parameters") from error
        return place, seed

    def damaged(self) -> dict[int, str]:
        """Row -> trial id of all trials that cannot be read, for :meth:`forget`."""
        definition = self.definition
        found = {}
        with explained(self.path):
            for row_id, trial_id, seed, text, payload in self._connection.execute(
                "SELECT rowid, trial_id, seed, parameters, result FROM trials"
            ):
                try:
                    self._place(definition, trial_id, seed, text)
                    if payload is not None:
                        decode_tables(payload)
                except (InputError, ValueError):
                    found[row_id] = trial_id
        return found

    def forget(self, rows: Iterable[int]) -> None:
        """Drops trials, so that they count as not done."""
        with self._transaction():
            self._connection.execute("REINDEX trials")  # finds a row whose damage is in its id
            self._connection.executemany("DELETE FROM trials WHERE rowid = ?", [(row,) for row in rows])

    def sizes(self) -> tuple[int, float, float]:
        """Of the finished trials: how many, their mean wall time in seconds, their mean size in bytes."""
        with explained(self.path):
            count, wall_s, size = self._connection.execute(
                "SELECT count(*), avg(wall_s), avg(length(result)) FROM trials WHERE status = 'finished'"
            ).fetchone()
        return count, wall_s or 0.0, size or 0.0


def _damaged(path: Path, trial_id: str, seed: int, part: str) -> InputError:
    return InputError(
        f"{path}: trial {trial_id} (seed {seed}): its {part} cannot be read, the file is damaged there;"
        " run the campaign's command again to repeat this trial; the others are kept"
    )


def _provenance(text: str) -> Provenance:
    try:
        return dict(json.loads(text))
    except (TypeError, ValueError):
        return {"damaged": text}


def open_or_create(path: Path, definition: Definition) -> Store:
    """The store of ``definition`` at ``path``: a new one, or the one there if ``definition`` extends it.

    Raises:
        InputError: as :func:`open_store`, or the store there is another campaign's.
    """
    connection = database.create(path, definition.to_json())
    if connection is not None:
        return Store(path, connection)
    store = open_store(path)
    try:
        store.extend(definition)
    except BaseException:
        store.close()
        raise
    return store


def open_store(path: Path) -> Store:
    """The store at ``path``, brought to the present schema.

    Raises:
        InputError: there is none; the file is another program's, damaged, or of a newer midnet-bench.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no campaign store here")
    return Store(path, database.open_existing(path))


def keep_aside(path: Path) -> Path | None:
    """Renames the store at ``path``, whatever it is, to the first free ``campaign.old-N.sqlite``."""
    if not path.exists():
        return None
    number = 1
    while (aside := path.with_name(f"{path.stem}.old-{number}{path.suffix}")).exists():
        number += 1
    journal = Path(f"{path}-journal")  # of a process that was killed: the old store needs it to open
    if journal.exists():
        journal.rename(f"{aside}-journal")
    return path.rename(aside)
