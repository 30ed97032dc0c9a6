"""The table of a readings campaign whose trials were written down: which reading stands first, and why."""

import math
from pathlib import Path
from typing import Any

import pytest

from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.payload import encode_tables
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.store import open_or_create
from midnet_bench.campaign.trial import Row, Scalar, TrialResult, TrialSpec
from midnet_bench.campaign.worker import Outcome
from midnet_bench.experiments.detection.counting import PAPER
from midnet_bench.experiments.readings.tables import FALSE, NOISE, tables

THE_PAPERS = {1: (6967, 176, 1889), 5: (14953, 1047, 619)}
"""robots -> tp, fp, fn"""
NEARLY = {1: (7000, 170, 1900), 5: (14900, 1050, 640)}
FAR = {1: (7000, 170, 3000), 5: (14900, 5000, 640)}
Counts = dict[int, tuple[int, int, int]]


def readings_campaign(folder: Path, readings: dict[str, tuple[Counts, int, int]]) -> Results:
    """Reading -> its counts on Map 1, and the false boxes of one and of five guards in 400 empty frames."""
    grid: dict[str, list[Scalar]] = {"robots": [1, 5], "arena": ["map1", "empty"]}
    with open_or_create(folder / "campaign.sqlite", Definition("readings", 1, 2, grid, {})) as store:
        run_id = store.begin_run(collect(1))
        for robots in (1, 5):
            for arena in ("map1", "empty"):
                for seed in (1, 2):
                    rows: list[Row] = []
                    for name, (counts, *false) in readings.items():
                        tp, fp, fn = counts[robots] if arena == "map1" else (0, false[robots > 1] // 2, 0)
                        frames = 1999 if arena == "map1" else 200
                        row: Row = {"reading": name, "has_intruders": arena == "map1", "frames": frames}
                        rows.append({**row, "tp": tp, "fp": fp, "fn": fn})
                    spec = TrialSpec("readings", {"robots": robots, "arena": arena}, seed)
                    payload = encode_tables(TrialResult({"readings": rows}, 1.0))
                    store.record(run_id, spec, Outcome(spec.trial_id, 1.0, 1.0, payload))
    return load_results(folder)


def ranked(results: Results) -> list[Any]:
    (table,) = tables(results)
    return list(table.rows)


def test_who_is_not_clean_comes_last_and_the_nearest_first(tmp_path: Path) -> None:
    rows = ranked(
        readings_campaign(
            tmp_path,
            {
                "noisy": (THE_PAPERS, 4, 0),
                "ghosts": (THE_PAPERS, 0, 8),
                "far": (FAR, 0, 0),
                "near": (NEARLY, 2, 2),
            },
        )
    )
    assert [row["reading"] for row in rows] == ["near", "far", "noisy", "ghosts"]
    assert [(row[NOISE], row[FALSE]) for row in rows] == [(1.0, 1.0), (0.0, 0.0), (2.0, 2.0), (0.0, 4.0)]


def test_counts_are_per_frame_and_weighed_by_what_there_was_to_find(tmp_path: Path) -> None:
    more = {1: (6967, 176 + 400, 1889), 5: THE_PAPERS[5]}
    (row,) = ranked(readings_campaign(tmp_path, {"default": (more, 0, 0)}))
    assert (row["tp(1)"], row["fp(1)"]) == pytest.approx((6967 / 1999, 576 / 1999))
    precision = 6967 / (6967 + 576) - 0.975
    f1 = 2 * 6967 / (2 * 6967 + 576 + 1889) - 0.871
    of_count = 400 / (6967 + 1889)
    assert row["largest of 12"] == pytest.approx(-precision, abs=1e-4)
    squares = precision**2 + f1**2 + of_count**2
    assert row["rms of 12"] == pytest.approx(math.sqrt(squares / 12), abs=1e-4)


def test_the_gap_is_to_the_papers_table(tmp_path: Path) -> None:
    (row,) = ranked(readings_campaign(tmp_path, {"default": (THE_PAPERS, 0, 0)}))
    for heading, score in (("P", "precision"), ("R", "recall"), ("F1", "f1")):
        for size in (1, 5):
            assert row[f"{heading}({size})"] == pytest.approx(PAPER[f"{size}-robot"][score], abs=0.001)
    assert row["largest gap"] < 0.001


def test_a_reading_without_a_team_of_five_has_no_gap_and_stands_last(tmp_path: Path) -> None:
    counts: Counts = {1: THE_PAPERS[1], 5: (0, 0, 0)}
    rows = ranked(readings_campaign(tmp_path, {"none": (counts, 0, 0), "far": (FAR, 0, 0)}))
    assert [row["reading"] for row in rows] == ["far", "none"]
    assert math.isnan(rows[1]["rms gap"])
