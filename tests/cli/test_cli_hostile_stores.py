"""A store or a table from elsewhere can hold anything: a command says so in a line and writes nothing."""

import csv
import hashlib
import json
import math
import shutil
import sqlite3
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from midnet_bench.campaign import store as rows
from midnet_bench.campaign.definition import Definition
from midnet_bench.experiments.registry import experiment, names
from tests.cli.command import midnet_bench, one_line_of_complaint, worked
from tests.stores import detection_store, labyrinth_result, labyrinth_store

DEEP = b"[" * 100_000 + b"]" * 100_000
Tables = dict[str, list[dict[str, Any]]]
Spoil = Callable[[Tables], object]


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


SPOILED: dict[str, tuple[str, Spoil]] = {
    "no GOSPA": ("table 'scores', column 'gospa_m': missing", lambda t: t["scores"][0].pop("gospa_m")),
    "no tp": ("table 'scores', column 'tp': missing", lambda t: t["scores"][0].pop("tp")),
    "no table": ("the table 'robots' is missing", lambda t: t.pop("robots")),
    "no robots": ("table 'robots' has 0 rows", lambda t: t["robots"].clear()),
    "two rows": ("table 'scores' has 2 rows", lambda t: t["scores"].append(t["scores"][0])),
    "another table": ("no trial has a table 'more'", lambda t: t.update(more=[{"x": 1}])),
    "another column": ("column 'note'", lambda t: t["scores"][0].update(note="x")),
    "another's seed": ("column 'seed'", lambda t: t["scores"][0].update(seed=77)),
    "no frames": ("column 'frames'", lambda t: t["scores"][0].update(frames=0)),
    "an infinite length": ("column 'gospa_m'", lambda t: t["scores"][0].update(gospa_m=math.inf)),
    "a huge length": ("column 'gospa_m'", lambda t: t["scores"][0].update(gospa_m=1e300)),
    "an odd share": ("column 'recall'", lambda t: t["scores"][0].update(recall=1.5)),
    "a line break": ("column 'robot'", lambda t: t["robots"][0].update(robot="a\x1b[2J\nb")),
    "an odd role": ("guard or intruder", lambda t: t["robots"][0].update(role="spy")),
}


def count_of(value: Any) -> tuple[str, Spoil]:
    """The fault and the spoiling of a count that is ``value``."""
    return "column 'tp': a whole number", lambda t: t["scores"][0].update(tp=value)


NO_COUNTS = ("abc", math.nan, "nan", None, True, 0.5, -1, 10**400)
SPOILED |= {f"a count that is {value!r:.9}": count_of(value) for value in NO_COUNTS}


@pytest.fixture(scope="module")
def detection(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scores = {1: dict.fromkeys((1, 2), (0.9, 0.5, 0.6)), 5: dict.fromkeys((1, 2), (0.8, 0.9, 0.8))}
    return detection_store(tmp_path_factory.mktemp("honest") / "detection", scores)


@contextmanager
def store_in(folder: Path) -> Iterator[sqlite3.Connection]:
    connection = sqlite3.connect(folder / "campaign.sqlite")
    with connection:
        yield connection
    connection.close()


def with_last(honest: Path, folder: Path, **changes: Any) -> Path:
    """A copy of the store whose last trial has other values, with a checksum that fits."""
    shutil.copytree(honest, folder)
    with store_in(folder) as store:
        (row_id,) = store.execute("SELECT max(rowid) FROM trials").fetchone()
        old = store.execute(f"SELECT {rows.COLUMNS} FROM trials WHERE rowid = ?", (row_id,)).fetchone()
        row = rows.TrialRow(*old[:-1])._replace(**changes)
        store.execute("DELETE FROM trials WHERE rowid = ?", (row_id,))
        store.execute(rows.INSERT, (*row, row.checksum))
    return folder


def tables_of_last(folder: Path) -> Tables:
    with store_in(folder) as store:
        (payload,) = store.execute("SELECT result FROM trials ORDER BY rowid DESC").fetchone()
    return dict(json.loads(zlib.decompress(payload)))


def tree(folder: Path) -> dict[str, str]:
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def refusal(folder: Path, at: Path, *command: object) -> str:
    """What a command says about a folder; nothing in ``at`` may change."""
    before = tree(at)
    complaint = one_line_of_complaint(midnet_bench(*command, folder, folder=at))
    assert len(complaint) <= 300
    assert tree(at) == before
    return complaint


@pytest.mark.parametrize("what", PAYLOADS)
def test_a_trial_that_is_none_is_refused(what: str, detection: Path, tmp_path: Path) -> None:
    folder = with_last(detection, tmp_path / "campaign", result=PAYLOADS[what])
    assert "(robots=5, seed=2): " in refusal(folder, tmp_path, "report")


@pytest.mark.parametrize("what", SPOILED)
def test_a_trial_of_other_columns_is_named(what: str, detection: Path, tmp_path: Path) -> None:
    fault, spoil = SPOILED[what]
    tables = tables_of_last(detection)
    spoil(tables)
    complaint = refusal(with_last(detection, tmp_path / "c", result=packed(tables)), tmp_path, "report")
    assert "(robots=5, seed=2): " in complaint
    assert fault in complaint


def test_no_command_reads_past_a_wrong_trial(detection: Path, tmp_path: Path) -> None:
    tables = tables_of_last(detection)
    del tables["scores"][0]["gospa_m"]
    for number, result in enumerate((packed(tables), PAYLOADS["a parent folder"])):
        folder = with_last(detection, tmp_path / str(number), result=result)
        commands = (("report",), ("verify",), ("compare", detection), ("report", "--format", "svg"))
        (complaint,) = {refusal(folder, tmp_path, *command) for command in commands}
        assert "(robots=5, seed=2): " in complaint


def test_more_caught_than_there_are_is_refused(tmp_path: Path) -> None:
    grid: dict[str, list[Any]] = {"intruders": [1], "robots": [1, 2]}
    labyrinth_store(tmp_path / "campaign.sqlite", lambda *_: 1, seeds=2, grid=grid).close()
    for column, limit in (("caught", "detected"), ("detected", "intruders")):
        tables: Any = labyrinth_result(1, 2, 1).tables
        tables["trial"][0][column] = 7
        folder = with_last(tmp_path, tmp_path / column / "c", result=packed(tables))
        assert f"column '{column}': 7 is more than {limit}" in refusal(folder, folder, "report")


@pytest.mark.parametrize(
    ("column", "value"),
    [("wall_s", math.inf), ("wall_s", -1.0), ("finished_utc", "now\n"), ("simulated_s", 1e300)],
)
def test_odd_times_of_a_trial_are_named(column: str, value: Any, detection: Path, tmp_path: Path) -> None:
    folder = with_last(detection, tmp_path / "c", **{column: value})
    assert f"seed=2): table 'timing', column '{column}'" in refusal(folder, tmp_path, "report")


@pytest.mark.parametrize(
    ("grid", "fault"),
    [
        ({"robots": ["abc"]}, "robots cannot be 'abc'"),
        ({"robots": [True, 5]}, "robots cannot be True"),
        ({"robots": [1, 0]}, "robots cannot be 0"),
        ({"robots": [1, 5], "seed": [1]}, "'seed' is no parameter"),
    ],
)
def test_a_definition_with_odd_parameters_is_refused(
    grid: Any, fault: str, detection: Path, tmp_path: Path
) -> None:
    folder = Path(shutil.copytree(detection, tmp_path / "c"))
    with store_in(folder) as store:
        definition = Definition("detection", 1, 2, grid, {})
        store.execute("UPDATE campaign SET definition = ?", (definition.to_json(),))
    assert fault in refusal(folder, tmp_path, "report")


CELLS: dict[str, tuple[str, str, str, str]] = {
    "a text": ("scores", "tp", "abc", "column 'tp': a whole number"),
    "nan": ("scores", "tp", "nan", "column 'tp': a whole number"),
    "empty": ("scores", "tp", "", "column 'tp': a whole number"),
    "a boolean": ("scores", "tp", "True", "column 'tp': a whole number"),
    "huge": ("scores", "tp", "9" * 400, "column 'tp': a whole number"),
    "a fraction": ("scores", "tp", "0.5", "column 'tp': a whole number"),
    "an infinite number": ("scores", "gospa_m", "inf", "column 'gospa_m': a number"),
    "nan for an empty cell": ("robots", "pose_error_m", "nan", "column 'pose_error_m': a number"),
    "a number of Python's": ("scores", "tp", "1_0", "column 'tp': a whole number"),
    "an odd seed": ("scores", "seed", "two", "column 'seed': a whole number"),
    "another value of the grid": ("scores", "robots", "3", "'3' is no value of the grid"),
    "the same trial again": ("scores", "seed", "1", "the same trial is there twice"),
    "an odd status": ("timing", "status", "perhaps", "column 'status': finished or failed"),
    "an odd time": ("timing", "wall_s", "long", "column 'wall_s': a number"),
    "collisions": ("robots", "collisions", "-1", "column 'collisions': a whole number"),
}


@pytest.fixture(scope="module")
def _exported(detection: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = Path(shutil.copytree(detection, tmp_path_factory.mktemp("files") / "c"))
    worked("report", folder, folder=folder)
    (folder / "campaign.sqlite").unlink()
    return folder


@pytest.fixture
def exported(_exported: Path, tmp_path: Path) -> Path:
    """A campaign's files without its store, for you to change."""
    tables = shutil.ignore_patterns("*.png", "*.svg", "*.tex", "*.html")
    return Path(shutil.copytree(_exported, tmp_path / "c", ignore=tables))


def change(path: Path, to_do: Callable[[list[list[str]]], list[list[str]]]) -> None:
    """Write a CSV file's lines anew."""
    with path.open(newline="") as file:
        lines = to_do(list(csv.reader(file)))
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)


@pytest.mark.parametrize("what", CELLS)
def test_an_odd_cell_of_a_file_is_named(what: str, exported: Path) -> None:
    name, column, value, fault = CELLS[what]

    def spoil(lines: list[list[str]]) -> list[list[str]]:
        lines[-1][lines[0].index(column)] = value
        return lines

    change(exported / f"{name}.csv", spoil)
    complaint = refusal(exported, exported, "verify")
    assert f"{name}.csv: " in complaint
    assert fault in complaint


@pytest.mark.parametrize("column", ["matched", "looked_at", "gospa_m", "fn_new_in_window"])
def test_a_missing_column_is_named_by_every_command(column: str, exported: Path, detection: Path) -> None:
    def without(lines: list[list[str]]) -> list[list[str]]:
        index = lines[0].index(column)
        return [line[:index] + line[index + 1 :] for line in lines]

    change(exported / "scores.csv", without)
    commands = (("report",), ("verify",), ("compare", detection)) if column == "matched" else (("verify",),)
    for command in commands:
        complaint = one_line_of_complaint(midnet_bench(*command, exported, folder=exported))
        assert f"scores.csv: the column '{column}' is missing" in complaint


def test_a_missing_or_empty_file_is_named(exported: Path) -> None:
    (exported / "timing.csv").unlink()
    assert "timing.csv: missing" in refusal(exported, exported, "verify")
    (exported / "timing.csv").write_bytes(b"\n")
    assert "timing.csv: missing" in refusal(exported, exported, "verify")


def test_every_experiment_says_its_columns() -> None:
    assert all(experiment(name).columns for name in names())
