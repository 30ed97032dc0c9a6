"""The tables of one trial as bytes in the store, and back: from elsewhere they may be anything."""

import json
import re
import zlib
from types import NoneType

from midnet_bench.campaign.trial import Row, TrialResult

TABLE_NAME = re.compile("[a-z][a-z0-9_]{0,63}")
"""what a trial's table may be called; it becomes the name of a file"""
OTHER_FILES = ("timing", "failures")
"""tables of the whole campaign, which no trial has"""
_SCALAR = (bool, int, float, str, NoneType)
UNPACKED_BYTES = 8_000_000
UNPACKED_TIMES = 12
"""tables unpack to at most ``UNPACKED_BYTES`` and so many times their packed size; ours to 8 times"""


def encode_tables(result: TrialResult) -> bytes:
    """A result's tables as compressed JSON: equal results give equal bytes, columns keep their order.

    Raises:
        ValueError: :func:`decode_tables` would not take them.
    """
    tables = {name: result.tables[name] for name in sorted(result.tables)}
    _check_tables(tables)
    text = json.dumps(tables, separators=(",", ":")).encode()
    payload = zlib.compress(text, level=6)
    if len(text) > _most_unpacked(payload):
        raise ValueError(f"the tables of a trial take {len(text)} bytes, nearly all of them repetitions")
    return payload


def decode_tables(payload: bytes) -> dict[str, list[Row]]:
    """The tables that :func:`encode_tables` packed.

    Raises:
        ValueError: ``payload`` is damaged, or of another origin. No table has a name with a path in it,
            and no more memory is taken than the tables of a trial need.
    """
    try:
        unpacking = zlib.decompressobj()
        text = unpacking.decompress(payload, _most_unpacked(payload))
        if not unpacking.eof or unpacking.unused_data:
            raise ValueError("the tables are cut off, or larger than a trial's")
        tables = json.loads(text)
    except (TypeError, RecursionError, zlib.error) as error:
        raise ValueError(str(error)) from error
    return _check_tables(tables)


def _most_unpacked(payload: bytes) -> int:
    return UNPACKED_BYTES + UNPACKED_TIMES * len(payload)


def _check_tables(tables: object) -> dict[str, list[Row]]:
    """The tables. Raises ValueError unless they are lists of rows of numbers, texts and None by name."""
    if not isinstance(tables, dict):
        raise ValueError("not tables by name")
    for name, rows in tables.items():
        if not isinstance(name, str) or not TABLE_NAME.fullmatch(name) or name in OTHER_FILES:
            raise ValueError(f"no table can be called {name!r}")
        if not isinstance(rows, list):
            raise ValueError(f"{name}: not a list of rows")
        for row in rows:
            if not isinstance(row, dict):
                raise ValueError(f"{name}: a row is not columns with values")
            for column, value in row.items():
                if not isinstance(value, _SCALAR):
                    raise ValueError(f"{name}: {column!r}: neither a number nor a text")
    return tables
