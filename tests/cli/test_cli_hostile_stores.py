"""A store from elsewhere can have any bytes in it: commands say so in a line and write nowhere else."""

import hashlib
import json
import shutil
import sqlite3
import tempfile
import zlib
from pathlib import Path

import pytest

from midnet_bench.campaign import store as rows
from midnet_bench.campaign.trial import Scalar
from tests.cli.command import midnet_bench, one_line_of_complaint
from tests.stores import labyrinth_store

DEEP = b"[" * 100_000 + b"]" * 100_000


def packed(tables: object) -> bytes:
    return zlib.compress(json.dumps(tables).encode())


PAYLOADS = {
    "a parent folder": packed({"../../evil": [{"x": 1}]}),
    "an absolute path": packed({f"{tempfile.gettempdir()}/evil": [{"x": 1}]}),
    "a path inside": packed({"a/b": [{"x": 1}]}),
    "an empty name": packed({"": [{"x": 1}]}),
    "a long name": packed({"x" * 300: [{"x": 1}]}),
    "a name with a line break": packed({"trial\nevil": [{"x": 1}]}),
    "a name with a NUL": packed({"trial\0": [{"x": 1}]}),
    "the name of our own file": packed({"timing": [{"x": 1}]}),
    "a name with a dot": packed({"configuration.json": [{"x": 1}]}),
    "no tables": packed([1, 2]),
    "no rows": packed({"trial": {"x": 1}}),
    "a row of nothing": packed({"trial": [3]}),
    "a value that is a list": packed({"trial": [{"caught": [1]}]}),
    "a value that is an object": packed({"trial": [{"caught": {"a": 1}}]}),
    "no JSON": zlib.compress(b"\xff\xfe not JSON"),
    "a number of a million digits": zlib.compress(b'{"trial":[{"x":' + b"9" * 1_000_000 + b"}]}"),
    "a hundred thousand brackets": zlib.compress(DEEP),
    "not packed": b"plain",
    "cut off": packed({"trial": [{"x": 1}]})[:-6],
    "a bomb": zlib.compress(b'{"trial":[' + b"{}," * 4_000_000 + b"{}]}"),
    "more behind the end": packed({"trial": []}) + b"more",
}


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("honest")
    grid: dict[str, list[Scalar]] = {"intruders": [1], "robots": [1, 2]}
    labyrinth_store(folder / "campaign.sqlite", lambda intruders, robots, seed: 1, seeds=2, grid=grid).close()
    return folder


def with_payload(honest: Path, folder: Path, payload: bytes) -> Path:
    """A copy of the store whose last trial has ``payload``, with a checksum that fits."""
    shutil.copytree(honest, folder)
    connection = sqlite3.connect(folder / "campaign.sqlite")
    (row_id,) = connection.execute("SELECT max(rowid) FROM trials").fetchone()
    old = connection.execute(f"SELECT {rows.COLUMNS} FROM trials WHERE rowid = ?", (row_id,)).fetchone()
    row = rows.TrialRow(*old[:-1])._replace(result=payload)
    connection.execute("DELETE FROM trials WHERE rowid = ?", (row_id,))
    connection.execute(rows.INSERT, (*row, row.checksum))
    connection.commit()
    connection.close()
    return folder


def tree(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.mark.parametrize("what", PAYLOADS)
def test_a_trial_that_is_none_is_refused_and_nothing_written(what: str, honest: Path, tmp_path: Path) -> None:
    folder = with_payload(honest, tmp_path / "campaign", PAYLOADS[what])
    before = tree(tmp_path)
    for command in (("report",), ("verify",), ("compare", honest), ("report", "--format", "svg")):
        complaint = one_line_of_complaint(midnet_bench(*command, folder, folder=tmp_path))
        assert len(complaint) <= 300
        assert "(intruders=1, robots=2, seed=2): " in complaint, complaint
        assert tree(tmp_path) == before
