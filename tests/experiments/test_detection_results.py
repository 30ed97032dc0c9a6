"""The tables of a detection campaign whose trials were written down."""

import math
from pathlib import Path

import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.statistics import Estimate
from midnet_bench.analysis.tables import Table
from midnet_bench.experiments.detection.tables import tables
from tests.stores import detection_store

SCORES = {1: {3: (0.9, 0.5, math.nan), 4: (0.7, 0.7, 0.7)}, 2: {3: (0.1, 0.2, 0.3), 4: (0.2, 0.3, 0.4)}}


@pytest.fixture
def made(tmp_path: Path) -> dict[str, Table]:
    return {table.name: table for table in tables(load_results(detection_store(tmp_path, SCORES)))}


def test_ratios_are_those_of_the_summed_counts(made: dict[str, Table]) -> None:
    first, second = made["detection_scores"].rows
    assert (first["trial"], second["trial"]) == ("1-robot", "2-robot")
    assert (first["frames"], first["tp"], first["fp"], first["fn"]) == (20, 16, 4, 8)
    assert (first["precision"], first["recall"]) == pytest.approx((16 / 20, 16 / 24))


def test_one_to_one_matching_counts_further_boxes_as_false(made: dict[str, Table]) -> None:
    row = made["detection_matching"].rows[0]
    assert (row["matched"], row["duplicates"], row["missed"]) == (12, 4, 12)
    assert (row["precision"], row["recall"]) == pytest.approx((12 / (12 + 4 + 4), 12 / 24))
    assert row["mean_error_m"] == pytest.approx(1.2 / 12)


def test_the_summary_has_ours_the_means_and_the_papers_row_where_there_is_one(made: dict[str, Table]) -> None:
    rows = made["detection_summary"].rows
    assert [(row["trial"], row["source"]) for row in rows] == [
        ("1-robot", "ours"),
        ("1-robot", "mean over seeds"),
        ("1-robot", "paper"),
        ("2-robot", "ours"),
        ("2-robot", "mean over seeds"),
    ]
    precision, f1 = rows[1]["precision"], rows[1]["f1"]
    assert isinstance(precision, Estimate)
    assert isinstance(f1, Estimate)
    assert (precision.value, precision.n) == (pytest.approx(0.8), 2)
    assert (f1.value, f1.n) == (0.7, 1), "an undefined score is left out"
    assert math.isnan(precision.low), "two seeds cannot tell"


def test_a_title_names_the_paper_only_where_its_row_is_there(tmp_path: Path) -> None:
    summary, *_ = tables(load_results(detection_store(tmp_path, {2: SCORES[2]})))
    assert "paper" not in summary.title


def test_the_comparison_and_the_seeds_are_plain_numbers(made: dict[str, Table]) -> None:
    row = made["detection_comparison"].flat_rows()[1]
    assert list(row) == ["trial", "score", "ours", "low", "high", "seeds", "paper", "difference"]
    assert (row["score"], row["paper"], row["difference"]) == ("recall", 0.787, pytest.approx(0.6 - 0.787))
    by_seed = made["scores_by_seed"].flat_rows()
    assert [(one["trial"], one["seed"]) for one in by_seed] == [
        ("1-robot", 3),
        ("1-robot", 4),
        ("2-robot", 3),
        ("2-robot", 4),
    ]
