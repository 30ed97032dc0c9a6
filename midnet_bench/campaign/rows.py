"""The tables of a store, a trial's row in it, and the checksum that says whether the row is damaged."""

import math
import struct
import zlib

ONE_ROW_EACH = "CREATE UNIQUE INDEX one_row_each ON trials (cell, seed)"
SCHEMA = (
    "CREATE TABLE campaign (definition TEXT NOT NULL)",
    "CREATE TABLE runs (run_id INTEGER PRIMARY KEY, provenance TEXT NOT NULL, ended_utc TEXT)",
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
    ONE_ROW_EACH,
)
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
