"""The table of readings: what it says of each, and which come first."""

from pathlib import Path

import pandas as pd
import pytest

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.definition import Definition
from midnet_bench.experiments.detection.counting import PAPER
from midnet_bench.experiments.readings.tables import tables


def rows_of(reading: str, shift: int = 0, noise: int = 0, ghosts: int = 0) -> list[dict[str, object]]:
    """One seed with the paper's counts, ``shift`` of its tp missed; boxes in 400 frames of an empty arena."""
    rows: list[dict[str, object]] = []
    for team, false_alone in (("1-robot", noise), ("5-robot", ghosts)):
        paper = PAPER[team]
        tp, fp, fn = int(paper["tp"] or 0), int(paper["fp"] or 0), int(paper["fn"] or 0)
        own = {"robots": int(team[0]), "seed": 1, "reading": reading}
        full = {"has_intruders": True, "frames": 1999, "tp": tp - shift, "fp": fp, "fn": fn + shift}
        empty = {"has_intruders": False, "frames": 400, "tp": 0, "fp": false_alone, "fn": 0}
        rows += [{**own, **full}, {**own, **empty}]
    return rows


def table_of(*rows: list[dict[str, object]]) -> Table:
    frame = pd.DataFrame([row for reading in rows for row in reading])
    definition = Definition("readings", 1, 1, {"robots": [1, 5]}, {})
    (table,) = tables(Results(Path("."), definition, [], {"readings": frame}, pd.DataFrame(), pd.DataFrame()))
    return table


def test_readings_are_ranked() -> None:
    """Those that report next to nothing in an empty arena first, of them the nearest to the paper."""
    table = table_of(
        rows_of("far", shift=1500),
        rows_of("nearest, but noise is detected", noise=3),
        rows_of("near, with ghosts", shift=20, ghosts=40),
        rows_of("near, next to no ghosts", shift=20, ghosts=2),
    )
    assert [row["reading"] for row in table.rows] == [
        "near, next to no ghosts",
        "far",
        "nearest, but noise is detected",
        "near, with ghosts",
    ]


def test_a_reading_that_counts_as_the_paper_has_no_gap_to_it() -> None:
    (row,) = table_of(rows_of("the paper's", noise=2, ghosts=6)).rows
    assert (row["P(1)"], row["R(1)"]) == pytest.approx((0.975, 0.787), abs=1e-3)
    assert (row["P(5)"], row["R(5)"]) == pytest.approx((0.935, 0.960), abs=1e-3)
    assert row["largest gap"] == pytest.approx(0.0, abs=1e-3)
    assert (row["noise_per_200_frames"], row["false_per_200_frames"]) == (1.0, 3.0)
