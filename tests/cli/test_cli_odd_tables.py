"""Tables of trials with missing columns, texts for numbers and the like: one line, and nothing is written."""

import csv
import json
import math
import sqlite3
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from midnet_bench.campaign import store as rows
from midnet_bench.campaign.definition import Definition
from midnet_bench.experiments.registry import experiment, names
from tests.cli.command import midnet_bench, one_line_of_complaint, worked
from tests.cli.test_cli_hostile_stores import tree, with_payload
from tests.stores import detection_store, labyrinth_result, labyrinth_store

Tables = dict[str, list[dict[str, Any]]]
Spoil = Callable[[Tables], object]

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


def tables_of_last(folder: Path) -> Tables:
    connection = sqlite3.connect(folder / "campaign.sqlite")
    (payload,) = connection.execute("SELECT result FROM trials ORDER BY rowid DESC").fetchone()
    connection.close()
    return dict(json.loads(zlib.decompress(payload)))


def packed(tables: object) -> bytes:
    return zlib.compress(json.dumps(tables).encode())


def refused(folder: Path, at: Path, *others: Path) -> set[str]:
    """What the four commands say about a folder; nothing in ``at`` may change."""
    before, said = tree(at), set()
    for command in (("report",), ("verify",), ("compare", *others), ("report", "--format", "svg")):
        complaint = one_line_of_complaint(midnet_bench(*command, folder, folder=at))
        assert len(complaint) <= 300
        assert tree(at) == before
        said.add(complaint)
    return said


@pytest.mark.parametrize("what", SPOILED)
def test_a_trial_of_other_columns_is_named(what: str, detection: Path, tmp_path: Path) -> None:
    fault, spoil = SPOILED[what]
    tables = tables_of_last(detection)
    spoil(tables)
    folder = with_payload(detection, tmp_path / "c", packed(tables))
    before = tree(tmp_path)
    complaint = one_line_of_complaint(midnet_bench("report", folder, folder=tmp_path))
    assert "(robots=5, seed=2): " in complaint
    assert fault in complaint
    assert tree(tmp_path) == before


def test_no_command_reads_past_a_wrong_trial(detection: Path, tmp_path: Path) -> None:
    tables = tables_of_last(detection)
    del tables["scores"][0]["gospa_m"]
    folder = with_payload(detection, tmp_path / "c", packed(tables))
    (complaint,) = refused(folder, tmp_path, detection)
    assert "(robots=5, seed=2): table 'scores', column 'gospa_m': missing" in complaint


def test_more_caught_than_there_are_is_refused(tmp_path: Path) -> None:
    labyrinth_store(
        tmp_path / "campaign.sqlite", lambda *_: 1, seeds=2, grid={"intruders": [1], "robots": [1, 2]}
    )
    for column, limit in (("caught", "detected"), ("detected", "intruders")):
        tables: Any = labyrinth_result(1, 2, 1).tables
        tables["trial"][0][column] = 7
        folder = with_payload(tmp_path, tmp_path / column / "c", packed(tables))
        complaint = one_line_of_complaint(midnet_bench("report", folder, folder=tmp_path))
        assert f"column '{column}': 7 is more than {limit}" in complaint


@pytest.mark.parametrize(
    ("column", "value"),
    [("wall_s", math.inf), ("wall_s", -1.0), ("finished_utc", "now\n"), ("simulated_s", 1e300)],
)
def test_odd_times_of_a_trial_are_named(column: str, value: Any, detection: Path, tmp_path: Path) -> None:
    folder = with_payload(detection, tmp_path / "c", packed(tables_of_last(detection)))
    connection = sqlite3.connect(folder / "campaign.sqlite")
    old = connection.execute(f"SELECT {rows.COLUMNS} FROM trials ORDER BY rowid DESC").fetchone()
    named = dict(zip(rows.COLUMNS.split(", "), old, strict=True)) | {column: value}
    del named["checksum"]
    row = rows.TrialRow(**named)
    connection.execute(rows.INSERT, (*row, row.checksum))
    connection.commit()
    connection.close()
    complaint = one_line_of_complaint(midnet_bench("report", folder, folder=tmp_path))
    assert f"seed=2): table 'timing', column '{column}'" in complaint


def test_a_definition_with_odd_parameters_is_refused(detection: Path, tmp_path: Path) -> None:
    cases = (
        ({"robots": ["abc"]}, "robots cannot be 'abc'"),
        ({"robots": [True, 5]}, "robots cannot be True"),
        ({"robots": [1, 0]}, "robots cannot be 0"),
        ({"robots": [1, 5], "seed": [1]}, "'seed' is no parameter"),
    )
    for number, (grid, fault) in enumerate(cases):
        folder = with_payload(detection, tmp_path / str(number), packed(tables_of_last(detection)))
        connection = sqlite3.connect(folder / "campaign.sqlite")
        definition = Definition("detection", 1, 2, grid, {})  # type: ignore[arg-type]
        connection.execute("UPDATE campaign SET definition = ?", (definition.to_json(),))
        connection.commit()
        connection.close()
        assert fault in one_line_of_complaint(midnet_bench("report", folder, folder=tmp_path))


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
def exported(detection: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = with_payload(
        detection, tmp_path_factory.mktemp("files") / "c", packed(tables_of_last(detection))
    )
    worked("report", folder, folder=folder)
    (folder / "campaign.sqlite").unlink()
    return folder


def table(path: Path) -> list[list[str]]:
    with path.open(newline="") as file:
        return list(csv.reader(file))


def write(path: Path, lines: list[list[str]]) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)


@pytest.mark.parametrize("what", CELLS)
def test_an_odd_cell_of_a_file_is_named(what: str, exported: Path) -> None:
    name, column, value, fault = CELLS[what]
    path = exported / f"{name}.csv"
    before, lines = path.read_bytes(), table(path)
    lines[-1][lines[0].index(column)] = value
    write(path, lines)
    there = tree(exported)
    complaint = one_line_of_complaint(midnet_bench("verify", exported, folder=exported))
    assert f"{name}.csv: " in complaint
    assert fault in complaint
    assert tree(exported) == there
    path.write_bytes(before)


def without(column: str, path: Path) -> None:
    """Take a column out of a file."""
    lines = table(path)
    place = lines[0].index(column)
    write(path, [line[:place] + line[place + 1 :] for line in lines])


@pytest.mark.parametrize("column", ["matched", "looked_at", "gospa_m", "fn_new_in_window"])
def test_a_missing_column_is_named_by_every_command(column: str, exported: Path, detection: Path) -> None:
    scores = exported / "scores.csv"
    kept = scores.read_bytes()
    without(column, scores)
    commands = (("report",), ("verify",), ("compare", detection)) if column == "matched" else (("verify",),)
    for command in commands:
        complaint = one_line_of_complaint(midnet_bench(*command, exported, folder=exported))
        assert f"scores.csv: the column '{column}' is missing" in complaint
    scores.write_bytes(kept)


def test_a_missing_or_empty_file_is_named(exported: Path) -> None:
    timing = exported / "timing.csv"
    kept = timing.read_bytes()
    timing.unlink()
    assert "timing.csv: missing" in one_line_of_complaint(midnet_bench("verify", exported, folder=exported))
    timing.write_bytes(b"\n")
    assert "timing.csv: missing" in one_line_of_complaint(midnet_bench("verify", exported, folder=exported))
    timing.write_bytes(kept)


def test_every_experiment_says_its_columns() -> None:
    assert all(experiment(name).columns for name in names())
