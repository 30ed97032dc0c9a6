"""The paper's claims against campaigns, and the sample sizes that differences need."""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from midnet_bench.analysis.claims import Verdict
from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.sample_size import (
    minimum_detectable_effect,
    probability_to_detect,
    sample_size,
    true_power,
)
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.tables import PAPER, Team
from midnet_bench.experiments.labyrinth.tables import claims as labyrinth_claims
from midnet_bench.workflows.verify import power_report, verify
from tests.stores import detection_store, labyrinth_store

DURATION = "a trial lasts at most 122 s on average"
REFERENCES = Path(__file__).parents[2] / "results" / "reference"


def binomial_counts(rates: list[float]) -> "dict[tuple[int, int, int], int]":
    rng = np.random.default_rng(5)
    return {
        (k, q, seed): int(rng.binomial(k, rates[q - 1]))
        for k in range(1, 6)
        for q in range(1, 6)
        for seed in range(1, 41)
    }


def campaign(folder: Path, rates: list[float], seeds: int, **grid: list[Scalar]) -> Path:
    """Trials whose intruders are caught at these rates by 1 to 5 robots; 1 to 5 intruders unless given."""
    counts = binomial_counts(rates)
    grid = {"intruders": [1, 2, 3, 4, 5], "robots": [1, 2, 3, 4, 5], **grid}
    store = folder / "campaign.sqlite"
    labyrinth_store(store, lambda k, q, seed: counts[k, q, seed], seeds=seeds, grid=grid).close()
    return folder


def verdicts(folder: Path) -> tuple[dict[str, str], int]:
    found = verify(folder)
    return {str(row["claim"]): str(row["verdict"]) for row in found.table.rows}, found.code


CLIMBS = [(1, 4), (1, 2), (2, 3), (3, 4)]
RATE = "{}: the success rate (percent) {} from {} to {}"


def climb(smaller: int, larger: int) -> str:
    return RATE.format("all intruders", "rises", f"{smaller} robot{'s' * (smaller > 1)}", larger)


@pytest.mark.slow
def test_a_clear_rise_holds_and_a_small_dip_is_inconclusive(tmp_path: Path) -> None:
    found, code = verdicts(campaign(tmp_path, [0.2, 0.4, 0.6, 0.85, 0.85], seeds=20))

    dips = [RATE.format(intruders, "falls", "4 robots", 5) for intruders in ("1 intruder", "5 intruders")]
    assert list(found) == [*(climb(*sizes) for sizes in CLIMBS), *dips, DURATION]
    assert [found[climb(*sizes)] for sizes in CLIMBS] == ["holds"] * 4
    assert found[DURATION] == "holds"
    assert found[dips[0]] == "inconclusive"
    assert code == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rates", "seeds", "intruders", "verdict", "code"),
    [
        ([0.9, 0.6, 0.3, 0.0, 0.9], 20, [5], "does not hold", 4),
        ([0.1, 0.4, 0.7, 1.0, 0.5], 20, [5], "holds", 0),
        ([0.1, 0.4, 0.7, 1.0, 0.5], 1, [1, 2, 3, 4, 5], "inconclusive", 3),
    ],
)
def test_a_curve_is_confirmed_turned_round_or_too_little_to_tell(
    rates: list[float], seeds: int, intruders: list[Scalar], verdict: str, code: int, tmp_path: Path
) -> None:
    found, exit_code = verdicts(campaign(tmp_path, rates, seeds, intruders=intruders))
    assert (DURATION in found) == (len(intruders) == 5), "the paper's hours are of all its cells"
    assert set(found.values()) == {verdict}
    assert exit_code == code


def test_a_step_says_how_many_curves_fall_there(tmp_path: Path) -> None:
    """Of three curves the one of one intruder falls from two robots to three, the others rise."""

    def caught(intruders: int, robots: int, seed: int) -> int:
        if robots == 3 and intruders == 1:
            return 0
        return min(intruders, (robots - 1) + seed % 2)

    grid: dict[str, list[Scalar]] = {"intruders": [1, 2, 3], "robots": [2, 3]}
    labyrinth_store(tmp_path / "campaign.sqlite", caught, seeds=6, grid=grid).close()
    (row,) = verify(tmp_path).table.rows
    assert row["claim"] == climb(2, 3), "one step is not judged twice"
    assert str(row["reason"]).endswith("1 of 3 curves falls there (1 intruders).")


@pytest.mark.slow
def test_trials_that_last_longer_than_the_papers_hours_allow_do_not_hold(tmp_path: Path) -> None:
    folder = campaign(tmp_path, [0.5] * 5, seeds=5)
    results = load_results(folder)
    trials = {"trial": results.table("trial").assign(duration_s=lambda frame: 124.0 + frame["seed"])}
    found = labyrinth_claims(replace(results, tables={**results.tables, **trials}))
    (duration,) = [one for one in found if one.claim == DURATION]
    assert (duration.ours.value, duration.verdict) == (pytest.approx(127.0), Verdict.DOES_NOT_HOLD)


def test_comparisons_are_made_seed_by_seed(tmp_path: Path) -> None:
    """Hard seeds hide a small gain from separate means; pairs of the same seed show it."""

    def caught(intruders: int, robots: int, seed: int) -> int:
        hard = seed % 2 == 0
        return (0 if hard else 3) + (robots > 1) + (robots > 1 and seed == 1)

    grid: dict[str, list[Scalar]] = {"intruders": [5], "robots": [1, 2]}
    labyrinth_store(tmp_path / "campaign.sqlite", caught, seeds=10, grid=grid).close()
    name, table, code, _ = verify(tmp_path)

    row = table.flat_rows()[0]
    assert row["ours"] == pytest.approx(22.0)
    assert 15.0 < float(row["low"] or 0) < 22.0 < float(row["high"] or 0) < 40.0
    assert (row["agreeing_seeds"], row["n"], row["verdict"]) == (10, 10, "holds")
    assert name == "labyrinth"
    assert code == 0


def paper_counts(robots: int, seed: int) -> Row:
    """The paper's own counts, each seed a little off."""
    paper = PAPER[Team(1 if robots == 1 else 5)]
    factor = 1.0 + 0.02 * math.sin(7.0 * seed + robots)
    return {"frames": 1999} | {name: round(factor * float(paper[name] or 0.0)) for name in ("tp", "fp", "fn")}


PAPERS = {1: (0.975, 0.787, 0.871), 5: (0.935, 0.960, 0.947)}
"""team size -> the paper's precision, recall and F1"""


def detection_campaign(
    folder: Path,
    scores: dict[int, tuple[float, float, float]] = PAPERS,
    seeds: int = 20,
    counted: Callable[[int, int], Row] = paper_counts,
) -> Path:
    """Scores by team size, each seed a little off, about the same for both teams."""
    each = {
        robots: {
            seed: (p + by, r + by, f1 + by)
            for seed in range(1, seeds + 1)
            for by in [0.01 * math.sin(seed + 0.2 * robots)]
        }
        for robots, (p, r, f1) in scores.items()
    }
    return detection_store(folder, each, counted=counted)


TABLE = [
    "1 robot: true positives per frame are 3.485",
    "1 robot: precision is 0.975",
    "1 robot: recall is 0.787",
    "5 robots: true positives per frame are 7.480",
    "5 robots: precision is 0.935",
    "5 robots: recall is 0.960",
]
ORDERS = [
    "recall rises from 1 robot to 5",
    "precision falls from 1 robot to 5",
    "F1 rises from 1 robot to 5",
]


def test_runs_like_the_papers_have_its_table_in_their_range(tmp_path: Path) -> None:
    counted = partial(causes, hidden=0.8, rare=0.02)
    found, code = verdicts(detection_campaign(tmp_path / "many", counted=counted))
    assert list(found)[:9] == TABLE + ORDERS
    assert set(list(found)[9:]) == {*CAUSES, "1 robot: few misses are due to scan delay", FEWER_HIDDEN} | {
        "5 robots: few false positives are due to scan delay"
    }
    assert [found.pop(claim) for claim in TABLE] == ["within the range of our runs"] * 6
    assert set(found.values()) == {"holds"}
    assert code == 0


def test_one_seed_decides_nothing_and_the_reference_is_told(tmp_path: Path) -> None:
    found = verify(detection_campaign(tmp_path, seeds=1))
    assert {row["verdict"] for row in found.table.rows} == {"inconclusive"}
    assert found.code == 3
    reference = load_results(REFERENCES / "detection")
    first, trials = reference.definition.base_seed, reference.definition.trials
    assert found.summary.startswith(
        "One seed decides nothing of the paper's 17 claims; --seeds 20 may. The packaged reference, seeds "
        f"{first} to {first + trials - 1}: of 17 claims "
    )
    two = verify(detection_campaign(tmp_path / "two", seeds=2))
    assert two.summary.startswith("Two seeds decide nothing of the paper's 17 claims; ")


def test_runs_of_other_lengths_than_the_papers_say_so(tmp_path: Path) -> None:
    def short(robots: int, seed: int) -> Row:
        return paper_counts(robots, seed) | {"frames": 200}

    for counted, notes in ((paper_counts, 0), (short, 6)):
        table = verify(detection_campaign(tmp_path / str(notes), counted=counted)).table
        told = [
            row for row in table.rows if "Our runs have 200 frames, the paper's 1999" in str(row["reason"])
        ]
        assert len(told) == notes


def causes(robots: int, seed: int, hidden: float, rare: float) -> Row:
    """The paper's counts, and of the misses of one guard a share that is hidden."""
    row = paper_counts(robots, seed)
    misses, false = float(row["fn"] or 0.0), float(row["fp"] or 0.0)
    wobble = 1.0 + 0.1 * math.sin(3.0 * seed)
    return row | {
        "fn_hidden": round(misses * wobble * (hidden if robots == 1 else 0.1)),
        "fn_new": round(misses * wobble * rare),
        "fn_outside_window": round(0.5 * misses),
        "fn_hidden_in_window": round(0.4 * misses * wobble * (hidden if robots == 1 else 0.1)),
        "fn_new_in_window": round(0.4 * misses * wobble * rare),
        "fp_left": round(false * wobble * rare),
        "overlapping": round(1999 * rare / 10.0) + seed % 2,
        "reordered": round(199 * rare / 10.0) + seed % 2,
        "looked_at": 199,
    }


CAUSES = [
    "1 robot: most misses are hidden intruders",
    "1 robot: few false positives are due to scan delay",
    "5 robots: few misses are due to scan delay",
    "5 robots: no fused boxes overlap",
    "5 robots: the order of the robots does not change the boxes",
]
FEWER_HIDDEN = "a frame has fewer misses of hidden intruders with 5 robots than with 1"


@pytest.mark.parametrize(("hidden", "rare", "verdict"), [(0.8, 0.02, "holds"), (0.3, 0.5, "does not hold")])
def test_the_papers_causes_and_its_words_on_the_fused_list_are_judged(
    tmp_path: Path, hidden: float, rare: float, verdict: str
) -> None:
    counted = partial(causes, hidden=hidden, rare=rare)
    found = verify(detection_campaign(tmp_path, counted=counted)).table
    rows = {str(row["claim"]): row for row in found.rows}
    assert {rows[claim]["verdict"] for claim in CAUSES} == {verdict}
    assert rows[FEWER_HIDDEN]["verdict"] == "holds"
    assert "10 % is our reading of that" in str(rows[CAUSES[1]]["reason"])
    assert "1 % of the frames is our reading of that" in str(rows[CAUSES[3]]["reason"])


def test_the_misses_inside_the_local_costmaps_stand_beside(tmp_path: Path) -> None:
    def counted(robots: int, seed: int) -> Row:
        """Nine misses of ten lie outside, in sight; of those inside four of five are hidden."""
        row = causes(robots, seed, hidden=0.1, rare=0.02)
        inside = float(row["fn"] or 0.0) / 10.0
        outside = {"fn_outside_window": round(9 * inside), "fn_hidden_in_window": round(0.8 * inside)}
        return row | outside

    rows = {
        str(row["claim"]): row for row in verify(detection_campaign(tmp_path, counted=counted)).table.rows
    }
    hidden = rows["1 robot: most misses are hidden intruders"]
    assert hidden["verdict"] == "does not hold"
    assert str(hidden["reason"]).startswith("Of misses inside the local costmap: 0.80")
    assert str(rows[FEWER_HIDDEN]["reason"]).startswith("Of intruders inside the local costmaps: -0.0")


def test_counts_far_off_are_outside(tmp_path: Path) -> None:
    def twice(robots: int, seed: int) -> Row:
        row = paper_counts(robots, seed)
        return row | {"tp": round(2.0 * float(row["tp"] or 0.0))}

    found, code = verdicts(detection_campaign(tmp_path, counted=twice))
    assert found[TABLE[0]] == found[TABLE[3]] == "outside the range of our runs"
    assert found[TABLE[1]] == "within the range of our runs"
    assert code == 4


def test_a_score_far_off_and_an_order_turned_round_are_told(tmp_path: Path) -> None:
    found, code = verdicts(detection_campaign(tmp_path, {1: (0.975, 0.6, 0.871), 5: (0.985, 0.96, 0.947)}))

    assert found["1 robot: recall is 0.787"] == "outside the range of our runs"
    assert found["precision falls from 1 robot to 5"] == "does not hold"
    assert found["recall rises from 1 robot to 5"] == "holds"
    assert found["5 robots: precision is 0.935"] == "outside the range of our runs", "0.05 off passed before"
    assert code == 4


def test_a_campaign_that_the_paper_says_nothing_of_is_refused(tmp_path: Path) -> None:
    folder = detection_campaign(tmp_path, {3: (0.9, 0.9, 0.9)})
    with pytest.raises(InputError, match="nothing here that the paper states"):
        verify(folder)
    with pytest.raises(InputError, match="a detection campaign; --difference works on labyrinth"):
        power_report(folder, 5.0)


@pytest.mark.parametrize(
    ("first", "dip", "intruders", "correlation", "expected"),
    [
        # item 70: from, dip, intruders per trial, correlation within a trial -> trials per team size
        (0.90, 0.10, 1, 0.0, 199),
        (0.90, 0.10, 5, 0.0, 40),  # 41 by Student's t: the notes take the normal distribution
        (0.90, 0.10, 5, 0.2, 72),
        (0.90, 0.05, 1, 0.0, 686),
        (0.90, 0.02, 5, 0.0, 769),
        (0.80, 0.05, 1, 0.0, 1094),
        (0.80, 0.02, 5, 0.2, 2344),
    ],
)
def test_the_numbers_of_trials_are_those_of_the_notes(
    first: float, dip: float, intruders: int, correlation: float, expected: int
) -> None:
    def variance(rate: float) -> float:
        return rate * (1 - rate) / intruders * (1 + (intruders - 1) * correlation)

    needed = sample_size(variance(first) + variance(first - dip), dip, groups=2)
    assert needed == pytest.approx(expected, rel=0.02, abs=1.01)


def test_the_power_is_what_it_says_it_is() -> None:
    """With the number of pairs that is asked for, a t test finds the difference four times in five."""
    pairs = int(sample_size(variance=400.0, difference=10.0))
    rng = np.random.default_rng(3)
    samples = rng.normal(10.0, 20.0, size=(20_000, pairs))
    found = stats.ttest_1samp(samples, 0.0, axis=1).pvalue < 0.05

    assert float(found.mean()) == pytest.approx(0.8, abs=0.03)


@pytest.mark.slow
def test_what_a_pilot_says_of_the_true_power_holds_in_nine_pilots_of_ten() -> None:
    """The variances of 40 pilots of 20 pairs are the quantiles of their distribution."""
    held = 0
    for pilot in (400.0 * stats.chi2.ppf((np.arange(40) + 0.5) / 40, 19) / 19).tolist():
        low, high = true_power(pilot, 19, difference=10.0)
        really = probability_to_detect(400.0, 10.0, int(sample_size(pilot, 10.0)), groups=1)
        held += low <= really <= high
        assert low < 0.6
        assert high > 0.9
    assert held == 36
    few, many = (true_power(400.0, freedom, 10.0) for freedom in (4, 199))
    assert few[0] < 0.3 < 0.7 < many[0] < 0.8 < many[1] < 0.9 < few[1]
    assert all(math.isnan(one) for one in true_power(math.nan, 19, 10.0))


def test_needed_trials_and_least_difference_are_inverse() -> None:
    for difference in (1.0, 5.0, 20.0):
        trials = sample_size(900.0, difference, power=0.9)
        assert minimum_detectable_effect(900.0, int(trials), power=0.9) == pytest.approx(difference, rel=0.05)
        assert minimum_detectable_effect(900.0, int(trials), power=0.9) <= difference
    assert math.isnan(sample_size(math.nan, 5.0))
    assert math.isnan(minimum_detectable_effect(900.0, 0))


@pytest.mark.slow
def test_the_power_table_stands_on_the_results_at_hand(tmp_path: Path) -> None:
    folder = campaign(tmp_path, [0.2, 0.4, 0.6, 0.85, 0.85], 40, intruders=[1, 5], robots=[4, 5])
    _, table = power_report(folder, difference=-5.0)

    rows = {row["intruders"]: row for row in table.rows}
    assert list(rows) == [1, 5, "all"]
    assert "5 points between 4 and 5 robots" in table.title
    one, five = rows[1], rows[5]
    assert float(one["sd"] or 0) == pytest.approx(100 * math.sqrt(0.85 * 0.15), rel=0.35)
    assert float(five["sd"] or 0) == pytest.approx(100 * math.sqrt(0.85 * 0.15 / 5), rel=0.35)
    assert float(five["trials_needed"] or 0) < float(one["trials_needed"] or 0)
    assert one["trials"] == 40
    (note,) = table.notes
    assert note.startswith(
        "The advice stands on 40 trials per team size, which tell the spread only roughly: "
    )


def test_common_seeds_make_it_cheaper_where_they_help(tmp_path: Path) -> None:
    def caught(intruders: int, robots: int, seed: int) -> int:
        return seed % 5 if robots == 4 or seed % 7 else min(5, seed % 5 + 1)

    grid: dict[str, list[Scalar]] = {"intruders": [5], "robots": [4, 5]}
    labyrinth_store(tmp_path / "campaign.sqlite", caught, seeds=20, grid=grid).close()

    row = power_report(tmp_path, difference=5.0)[1].rows[0]
    assert float(row["pairs_needed"] or 0) < 0.2 * float(row["trials_needed"] or 0)
    assert float(row["mde_paired"] or 0) < float(row["mde"] or 0)


def test_cells_without_any_spread_give_no_number(tmp_path: Path) -> None:
    grid: dict[str, list[Scalar]] = {"intruders": [1], "robots": [4, 5]}
    labyrinth_store(tmp_path / "campaign.sqlite", lambda k, q, seed: 1, seeds=5, grid=grid).close()

    _, table = power_report(tmp_path, difference=5.0)
    assert math.isnan(float(table.rows[0]["trials_needed"] or 0))
    assert "n/a" in table.to_markdown()
    assert table.notes == []


def test_questions_that_make_no_sense_are_refused(tmp_path: Path) -> None:
    grid: dict[str, list[Scalar]] = {"intruders": [1], "robots": [4, 5]}
    labyrinth_store(tmp_path / "campaign.sqlite", lambda k, q, seed: 1, seeds=2, grid=grid).close()
    for difference, robots, power, complaint in (
        (0.0, (4, 5), 0.8, "--difference 0"),
        (101.0, (4, 5), 0.8, "--difference 101"),
        (5.0, (4, 6), 0.8, "no finished trials with 6 robots"),
        (5.0, (4, 4), 0.8, "--robots 4 4"),
        (5.0, (4, 5), 1.0, "--power 1"),
    ):
        with pytest.raises(InputError, match=complaint):
            power_report(tmp_path, difference, robots, power)


@pytest.mark.parametrize(
    ("name", "claims", "code"), [("detection", 17, 4), ("detection-edge", 17, 4), ("labyrinth", 7, 3)]
)
def test_the_committed_references_are_verified_without_a_store(name: str, claims: int, code: int) -> None:
    assert not (REFERENCES / name / "campaign.sqlite").exists()
    found = verify(REFERENCES / name)
    assert len(found.table.rows) == claims
    assert found.summary.startswith(f"Of {claims} claims ")
    assert found.code == code
    for row in found.table.rows:
        assert not math.isnan(float(str(row["p_value"])))
        if row["verdict"] == "inconclusive":
            needed = float(str(row["seeds_needed"]))
            assert ("no number of seeds" if math.isinf(needed) else " seeds would decide it") in str(
                row["reason"]
            )
            assert needed > 20
        else:
            assert row["seeds_needed"] is None
