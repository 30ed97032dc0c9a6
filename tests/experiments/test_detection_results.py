"""The tables of a detection campaign whose trials were written down."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.experiments.detection.conclusions import claims, headline
from midnet_bench.experiments.detection.tables import PAPER, Team, tables, window_notes
from tests.stores import detection_store

SCORES = {1: {3: (0.9, 0.5, math.nan), 4: (0.7, 0.7, 0.7)}, 2: {3: (0.1, 0.2, 0.3), 4: (0.2, 0.3, 0.4)}}

COUNTINGS = ("every", "surplus_false")
SOURCES = ("ours", "mean over seeds")


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


def test_second_boxes_are_counted_both_ways_beside_the_papers_row(made: dict[str, Table]) -> None:
    rows = made["detection_counting"].rows
    assert [row["trial"] for row in rows] == ["1-robot"] * 3 + ["2-robot"] * 2
    assert [row["counting"] for row in rows] == [*COUNTINGS, "paper", *COUNTINGS]
    every, surplus, paper = rows[:3]
    per_frame = ("tp_per_frame", "fp_per_frame", "fn_per_frame", "boxes_per_frame")
    assert [every[name] for name in per_frame] == pytest.approx([0.8, 0.2, 0.4, 1.0])
    assert [surplus[name] for name in per_frame] == pytest.approx([0.6, 0.4, 0.4, 1.0])
    assert paper["boxes_per_frame"] == pytest.approx((6967 + 176) / 1999)
    for row, precision, recall in ((every, 0.8, 8 / 12), (surplus, 0.6, 6 / 10)):
        means = [row[score].value for score in ("precision", "recall", "f1")]  # type: ignore[union-attr]
        assert means == pytest.approx([precision, recall, 2 * precision * recall / (precision + recall)])


@pytest.mark.parametrize("tp_boxes", ["one_per_intruder", "surplus_false"])
def test_both_countings_and_the_matching_are_the_same_whichever_a_campaign_has_stored(
    tmp_path: Path, made: dict[str, Table], tp_boxes: str
) -> None:
    fp = 4 if tp_boxes == "surplus_false" else 2
    folder = detection_store(
        tmp_path / "again", SCORES, counted=lambda *_: {"tp": 6, "fp": fp}, parameters={"tp_boxes": tp_boxes}
    )
    again = {table.name: table for table in tables(load_results(folder))}
    for name in ("detection_counting", "detection_matching"):
        assert again[name].to_csv() == made[name].to_csv(), name
    assert again["detection_scores"].rows[0]["fp"] == 2 * fp


def test_the_distance_from_the_papers_table_is_what_its_numbers_say(tmp_path: Path) -> None:
    """The paper's own counts; of five robots none, one or five more false positives a frame, by seed."""
    more = {1: 0, 2: 1, 3: 5}

    def counts(robots: int, seed: int) -> Row:
        paper = PAPER[Team(robots)]
        tp, fp, fn = (int(str(paper[name])) for name in ("tp", "fp", "fn"))
        fp += 1999 * more[seed] * (robots == 5)
        return {"frames": 1999, "tp": tp, "fp": fp, "fn": fn, "matched": tp, "duplicates": 0}

    ratios = dict.fromkeys(more, (0.9, 0.9, 0.9))
    folder = detection_store(tmp_path / "near", {1: ratios, 5: ratios}, counted=counts)
    rows = {
        (str(row["counting"]), str(row["numbers"])): row
        for row in next(one for one in tables(load_results(folder)) if one.name == "detection_distance").rows
    }
    assert rows["every", "all twelve"] == {**rows["surplus_false", "all twelve"], "counting": "every"}

    def by_hand(seeds: list[int], twelve: bool) -> float:
        tp, fp, fn = (float(str(PAPER[Team(5)][name])) for name in ("tp", "fp", "fn"))
        off: list[float] = []
        precisions = [tp / (tp + fp + 1999 * more[seed]) for seed in seeds]
        recall = tp / (tp + fn)
        off.append(sum(precisions) / len(seeds) - 0.935)
        off.append(sum(2 * p * recall / (p + recall) for p in precisions) / len(seeds) - 0.947)
        off += [sum(1999 * more[seed] for seed in seeds) / len(seeds) / (tp + fn)] * twelve
        return math.sqrt(sum(one**2 for one in off) / (12 if twelve else 6))

    for numbers in ("six ratios", "all twelve"):
        row, twelve = rows["every", numbers], numbers == "all twelve"
        distance = row["distance"]
        assert distance.value == pytest.approx(by_hand([1, 2, 3], twelve), abs=5e-4)  # ratios are rounded
        assert row["least_without_a_seed"] == pytest.approx(by_hand([1, 2], twelve), abs=5e-4)
        assert row["most_without_a_seed"] == pytest.approx(by_hand([2, 3], twelve), abs=5e-4)
        # of three seeds, one in 27 samples has the nearest alone, and one in 27 the farthest
        assert distance.low == pytest.approx(by_hand([1], twelve), abs=1e-3)
        assert distance.high == pytest.approx(by_hand([3], twelve), abs=5e-4)
    assert "detection_distance" not in {
        one.name for one in tables(load_results(detection_store(tmp_path / "one", {1: ratios})))
    }


def test_the_summary_has_ours_the_means_and_the_papers_row_where_there_is_one(made: dict[str, Table]) -> None:
    rows = made["detection_summary"].rows
    assert [row["trial"] for row in rows] == ["1-robot"] * 3 + ["2-robot"] * 2
    assert [row["source"] for row in rows] == [*SOURCES, "paper", *SOURCES]
    precision, f1 = rows[1]["precision"], rows[1]["f1"]
    assert (precision.value, precision.n) == (pytest.approx(0.8), 2)
    assert (f1.value, f1.n) == (0.7, 1), "an undefined score is left out"
    assert math.isnan(precision.low), "two seeds cannot tell"


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (
            {"local_size_m": 3.5, "obstacle_range_m": 2.5},
            ["The 3.5 m local costmap ends 1.75 m ahead; the usable range is 2.5 m"],
        ),
        ({"local_size_m": 5.0, "obstacle_range_m": 2.5}, []),
        ({"local_size_m": 3.0, "obstacle_range_m": 2.5, "oracle": "window"}, []),
        ({}, []),
    ],
)
def test_a_local_costmap_that_ends_before_the_usable_range_is_told(
    tmp_path: Path, given: dict[str, Scalar], told: list[str]
) -> None:
    summary, *_ = tables(load_results(detection_store(tmp_path, {2: SCORES[2]}, parameters=given)))
    assert [note.split(":")[0] for note in summary.notes if "costmap" in note] == told


def test_each_costmap_of_a_sweep_that_is_too_small_is_told() -> None:
    sizes: list[Scalar] = [3.0, 4.0, 6.0]
    notes = window_notes(Definition("detection", 1, 1, {"local_size_m": sizes}, {"obstacle_range_m": 2.5}))
    assert [note.split(" local")[0] for note in notes] == ["The 3 m", "The 4 m"]


def test_the_comparison_and_the_seeds_are_plain_numbers(made: dict[str, Table]) -> None:
    row = made["detection_comparison"].flat_rows()[1]
    assert list(row) == [
        "trial",
        "score",
        "ours",
        "low",
        "high",
        "seeds",
        "paper",
        "difference",
        "run_low",
        "run_high",
        "p_value",
    ]
    assert (row["score"], row["paper"], row["difference"]) == ("recall", 0.787, pytest.approx(0.6 - 0.787))
    by_seed = made["scores_by_seed"].flat_rows()
    trials = [(team, seed) for team in ("1-robot", "2-robot") for seed in (3, 4)]
    assert [(one["trial"], one["seed"]) for one in by_seed] == trials


def test_the_comparison_has_all_twelve_numbers_and_the_papers_run_among_ours(tmp_path: Path) -> None:
    """By scipy's t test of one run against ours; three trials of the counts that the store has."""
    scores = {1: {seed: (0.9 + 0.01 * seed, 0.7, 0.8) for seed in (1, 2, 4)}}
    counts: Callable[[int, int], Row] = lambda robots, seed: {"frames": 10, "fp": seed}  # noqa: E731
    made = {
        table.name: table for table in tables(load_results(detection_store(tmp_path, scores, counted=counts)))
    }
    rows = {row["score"]: row for row in made["detection_comparison"].flat_rows()}
    assert list(rows) == ["precision", "recall", "f1", "tp_per_frame", "fp_per_frame", "fn_per_frame"]
    false = rows["fp_per_frame"]
    assert false["paper"] == pytest.approx(176 / 1999)
    low, high = stats.t.interval(0.95, 2, 7 / 30, np.std([0.1, 0.2, 0.4], ddof=1) * math.sqrt(4 / 3))
    assert (false["run_low"], false["run_high"]) == (0.0, pytest.approx(high)), "no count is below 0"
    assert low < 0.0
    precision = rows["precision"]
    expected = stats.ttest_ind([0.91, 0.92, 0.94], [0.975]).pvalue
    assert precision["p_value"] == pytest.approx(expected)
    assert rows["recall"]["p_value"] != rows["recall"]["p_value"], "three equal numbers show no spread"


@pytest.mark.parametrize(
    ("precision", "told"),
    [
        (
            0.97,
            "6 of 6 numbers of the paper's table are within the range of our runs (95 % prediction "
            "intervals).",
        ),
        (0.5, "; outside: precision of 1 robot."),
    ],
)
def test_the_headline_says_whether_the_papers_table_is_among_our_runs(
    tmp_path: Path, precision: float, told: str
) -> None:
    def counted(robots: int, seed: int) -> Row:
        off = seed - 3
        return {"frames": 1999, "tp": 6967 + 40 * off, "fp": 176 + 10 * off, "fn": 1889 + 50 * off}

    scores = {
        1: {
            seed: (precision + 0.003 * (seed - 3), 0.785 + 0.01 * (seed - 3), 0.87 + 0.01 * (seed - 3))
            for seed in range(1, 6)
        }
    }
    results = load_results(detection_store(tmp_path, scores, counted=counted))
    assert headline(results).conclusion[-1].endswith(told)
    few = {1: {seed: scores[1][seed] for seed in (1, 2)}}
    alone = load_results(detection_store(tmp_path / "few", few, counted=counted))
    assert not any("prediction" in sentence for sentence in headline(alone).conclusion)


def test_in_another_arena_the_papers_rows_and_claims_are_left_out(tmp_path: Path) -> None:
    for arena, is_the_papers in (("map1", True), ("office", False)):
        folder = detection_store(tmp_path / arena, SCORES, parameters={"arena": arena})
        results = load_results(folder)
        made = {table.name: table for table in tables(results)}
        for name, column in (("detection_summary", "source"), ("detection_counting", "counting")):
            assert ("paper" in [row[column] for row in made[name].rows]) == is_the_papers
        assert ("paper" in made["detection_summary"].title) == is_the_papers
        assert math.isnan(made["detection_comparison"].rows[0]["paper"]) != is_the_papers  # type: ignore[arg-type]
        assert bool(claims(results)) == is_the_papers
