"""The tables of a store, a trial's row in it, and the checksum that says whether the row is damaged."""

import math
import struct
import zlib
from typing import NamedTuple

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
_NUMBERS = struct.Struct("<qqqdd??")


class TrialRow(NamedTuple):
    """What the table ``trials`` has of a trial: failed if it has a traceback, finished if it has a result."""

    cell: int
    seed: int
    run_id: int
    simulated_s: float | None
    wall_s: float
    finished_utc: str
    traceback: str | None
    result: bytes | None

    @property
    def checksum(self) -> int:
        """The CRC-32 of all of it; it is found a million times where a million trials go on."""
        cell, seed, run_id, simulated_s, wall_s, finished_utc, traceback, result = self
        times = math.nan if simulated_s is None else simulated_s, wall_s
        numbers = _NUMBERS.pack(cell, seed, run_id, *times, traceback is None, result is None)
        text = finished_utc if traceback is None else finished_utc + traceback
        return zlib.crc32(
            result or b"", zlib.crc32(text.encode("utf-8", "surrogatepass"), zlib.crc32(numbers))
        )

    def is_sound(self, checksum: object) -> bool:
        """Whether the values are those that were written with this checksum."""
        try:
            return checksum == self.checksum
        except (AttributeError, TypeError, struct.error):  # values of other types
            return False


COLUMNS = f"{', '.join(TrialRow._fields)}, checksum"
"""of the table ``trials``: a :class:`TrialRow` and its checksum"""
INSERT = f"INSERT OR REPLACE INTO trials ({COLUMNS}) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)"
