"""A trial's row in the store, the checksum that tells whether it is damaged, and rows of older stores."""

import json
import math
import sqlite3
import struct
import zlib
from collections.abc import Iterator

from midnet_bench.campaign.payload import decode_tables
from midnet_bench.campaign.trial import Cell

TABLES = (
    "CREATE TABLE cells (cell INTEGER PRIMARY KEY, parameters TEXT NOT NULL)",
    """CREATE TABLE trials (
        cell INTEGER NOT NULL,
        seed INTEGER NOT NULL,
        run_id INTEGER NOT NULL,
        simulated_s REAL,
        wall_s REAL NOT NULL,
        finished_utc TEXT NOT NULL,
        checksum INTEGER NOT NULL,
        traceback TEXT,
        result BLOB
    )""",
)
ONE_ROW_EACH = "CREATE UNIQUE INDEX one_row_each ON trials (cell, seed)"
INSERT = "INSERT OR REPLACE INTO trials VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"
COLUMNS = "cell, seed, run_id, simulated_s, wall_s, finished_utc, checksum, traceback, result"
"""of the table ``trials``, and of a :data:`Row`"""

Row = tuple[int, int, int, float | None, float, str, int, str | None, bytes | None]
"""A trial has failed if it has a traceback, and is finished if it has a result."""

_NUMBERS = struct.Struct("<qqqdd??")


def row(
    cell: int,
    seed: int,
    run_id: int,
    simulated_s: float | None,
    wall_s: float,
    finished_utc: str,
    traceback: str | None,
    result: bytes | None,
) -> Row:
    """The values for :data:`INSERT`, with their checksum."""
    checksum = _checksum(cell, seed, run_id, simulated_s, wall_s, finished_utc, traceback, result)
    return cell, seed, run_id, simulated_s, wall_s, finished_utc, checksum, traceback, result


def is_sound(row: Row) -> bool:
    """Whether a row's values are those that were written."""
    cell, seed, run_id, simulated_s, wall_s, finished_utc, checksum, traceback, result = row
    try:
        return checksum == _checksum(cell, seed, run_id, simulated_s, wall_s, finished_utc, traceback, result)
    except (AttributeError, TypeError, struct.error):  # values of other types
        return False


def _checksum(
    cell: int,
    seed: int,
    run_id: int,
    simulated_s: float | None,
    wall_s: float,
    finished_utc: str,
    traceback: str | None,
    result: bytes | None,
) -> int:
    """The CRC-32 of all that a row holds; it is found a million times where a million trials go on."""
    times = math.nan if simulated_s is None else simulated_s, wall_s
    numbers = _NUMBERS.pack(cell, seed, run_id, *times, traceback is None, result is None)
    text = finished_utc if traceback is None else finished_utc + traceback
    return zlib.crc32(result or b"", zlib.crc32(text.encode("utf-8", "surrogatepass"), zlib.crc32(numbers)))


def keep_parameters_by_cell(connection: sqlite3.Connection) -> None:
    """Schema 1, whose rows repeat all parameters, becomes schema 2. Raises ValueError if it is damaged."""
    connection.execute("ALTER TABLE trials RENAME TO trials_1")
    for statement in TABLES:
        connection.execute(statement)
    campaign = connection.execute("SELECT definition FROM campaign").fetchone()
    (definition,) = campaign or ('{"experiment": ""}',)  # a new store has yet to get its campaign
    try:
        experiment = json.loads(definition)["experiment"]
    except (KeyError, TypeError) as error:
        raise ValueError("this is no definition") from error
    cells: dict[str, Cell | None] = {}
    connection.executemany(INSERT, _converted(connection, experiment, cells))
    connection.executemany(
        "INSERT OR IGNORE INTO cells VALUES (?, ?)",
        [(cell.number, text) for text, cell in cells.items() if cell is not None],
    )
    connection.execute("DROP TABLE trials_1")
    connection.execute(ONE_ROW_EACH)


def _converted(
    connection: sqlite3.Connection, experiment: str, cells: dict[str, Cell | None]
) -> Iterator[Row]:
    """The rows of ``trials_1``; their cells are added to ``cells``. Those that are damaged stay so."""
    old = connection.execute(
        "SELECT rowid, trial_id, parameters, seed, run_id, simulated_s, wall_s, finished_utc, traceback,"
        " result FROM trials_1 ORDER BY rowid"
    )
    for row_id, trial_id, parameters, seed, run_id, simulated_s, wall_s, utc, failure, result in old:
        if parameters not in cells:
            cells[parameters] = _cell(experiment, parameters)
        cell = cells[parameters]
        try:
            if cell is None or cell.trial_id(seed) != trial_id:
                raise ValueError("the id is a hash of the parameters and the seed, and not of these")
            if result is not None:
                decode_tables(result)
            yield row(cell.number, seed, run_id, simulated_s, wall_s, utc, failure, result)
        except (AttributeError, TypeError, ValueError, struct.error):
            number = -row_id if cell is None else cell.number
            yield number, seed, run_id, simulated_s, wall_s, utc, -1, failure, result


def _cell(experiment: str, text: str) -> Cell | None:
    try:
        return Cell(experiment, dict(json.loads(text)))
    except (TypeError, ValueError):
        return None
