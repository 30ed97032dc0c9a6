"""A paper's claims: verdicts by the whole interval, by Holm, by one further run; and why one is open."""

import math
from functools import partial

import numpy as np
import pytest
from scipy import stats

from midnet_bench.analysis.claims import (
    Finding,
    Verdict,
    comparison,
    finding,
    is_decided,
    judged,
    lines_by_verdict,
    single_run,
    summary,
    verdict_table,
)
from midnet_bench.analysis.sample_size import probability_to_detect
from midnet_bench.analysis.statistics import Estimate, mean

RUNS = [0.95, 0.96, 0.97, 0.98, 0.99]
HALF = float(stats.t.ppf(0.975, 4)) * math.sqrt(0.00025) * math.sqrt(1.2)  # of their prediction interval


@pytest.mark.parametrize(
    ("low", "high", "above", "below", "verdict"),
    [
        (0.1, 0.3, 0.0, math.inf, Verdict.HOLDS),
        (0.0, 0.3, 0.0, math.inf, Verdict.INCONCLUSIVE),
        (-0.1, 0.3, 0.0, math.inf, Verdict.INCONCLUSIVE),
        (-0.3, -0.1, 0.0, math.inf, Verdict.DOES_NOT_HOLD),
        (-0.3, -0.1, -math.inf, 0.0, Verdict.HOLDS),
        (0.0, 0.0, -math.inf, 0.0, Verdict.INCONCLUSIVE),
        (0.91, 0.97, 0.9, 1.0, Verdict.HOLDS),
        (0.89, 0.97, 0.9, 1.0, Verdict.INCONCLUSIVE),
        (0.8, 1.1, 0.9, 1.0, Verdict.INCONCLUSIVE),
        (0.8, 0.85, 0.9, 1.0, Verdict.DOES_NOT_HOLD),
        (math.nan, math.nan, 0.9, 1.0, Verdict.INCONCLUSIVE),
    ],
)
def test_the_whole_interval_decides(
    low: float, high: float, above: float, below: float, verdict: Verdict
) -> None:
    assert Finding("", Estimate((low + high) / 2, low, high, 20), above, below).verdict == verdict


@pytest.mark.parametrize(
    ("paper", "verdict"),
    [
        (0.97, Verdict.WITHIN),
        (0.97 - HALF + 1e-9, Verdict.WITHIN),
        (0.97 - HALF - 1e-9, Verdict.OUTSIDE),
        (0.97 + HALF + 1e-9, Verdict.OUTSIDE),
    ],
)
def test_a_run_of_the_paper_is_within_or_outside_and_p_agrees(paper: float, verdict: Verdict) -> None:
    found = single_run("", RUNS, paper)
    assert found.verdict == verdict
    assert (found.p_value < 0.05) == (verdict is Verdict.OUTSIDE)
    assert judged([found])[0].verdict == verdict


def test_the_perfect_score_is_outside_the_range_of_runs_that_never_reach_it() -> None:
    """An equivalence margin of 0.05 around 0.975 let a precision of 1.000 pass."""
    runs = [0.975 + 0.003 * math.sin(seed) for seed in range(20)]
    assert single_run("", runs, 1.0, (0.0, 1.0)).verdict is Verdict.OUTSIDE
    assert single_run("", runs, 0.975, (0.0, 1.0)).verdict is Verdict.WITHIN


def test_each_run_is_judged_by_itself_and_directions_by_holm() -> None:
    """One outside among many is told; one direction among many needs a smaller p."""
    runs = [single_run(f"run {number}", RUNS, paper) for number, paper in enumerate([0.97] * 9 + [1.02])]
    assert 0.02 < runs[-1].p_value < 0.05
    assert [each.verdict for each in judged(runs)] == [Verdict.WITHIN] * 9 + [Verdict.OUTSIDE]
    assert all(math.isnan(each.p_holm) for each in judged(runs))

    sample = np.random.default_rng(4).normal(0.6, 1.0, 20).tolist()
    direction = finding("rises", partial(mean, sample), 0.0, math.inf)
    assert 0.005 < direction.p_value < 0.05
    assert judged([direction])[0].verdict is Verdict.HOLDS
    (first, *_) = judged([direction, *runs])
    assert first.verdict is Verdict.HOLDS, "numbers of single runs are no part of Holm's family"
    unclear = [finding("", partial(mean, [-1.0, 0.5, 0.8]), 0.0, math.inf)] * 9
    (first, *_) = judged([direction, *unclear])
    assert first.verdict is Verdict.INCONCLUSIVE
    assert first.p_holm == pytest.approx(10 * direction.p_value)
    assert "leaves out 0, but not after Holm's adjustment for 10 claims" in first.reason


def test_the_seeds_that_an_open_claim_needs_are_those_of_students_test() -> None:
    sample = np.random.default_rng(1).normal(0.0, 1.0, 20)
    sample = (sample - sample.mean()) / sample.std(ddof=1) + 0.3  # mean 0.3, standard deviation 1
    found = finding("it rises", partial(mean, sample.tolist()), 0.0, math.inf)
    assert found.deviation == pytest.approx(1.0, rel=0.01)
    (judgement,) = judged([found])
    assert judgement.verdict is Verdict.INCONCLUSIVE
    assert judgement.seeds_needed == pytest.approx(90, abs=2)  # ((1.96 + 0.84) / 0.3) ** 2 = 87, normal
    assert probability_to_detect(1.0, 0.3, int(judgement.seeds_needed), 1) == pytest.approx(0.8, abs=0.02)
    assert judgement.reason == (
        "The 95 % interval holds 0; about 90 seeds would decide it, were the truth what these 20 show."
    )
    two = judged([found, found])
    assert two[0].seeds_needed > judgement.seeds_needed * 1.15, "two open claims share the 5 %"


def test_that_many_more_seeds_do_decide_it_in_four_cases_of_five() -> None:
    rng = np.random.default_rng(7)
    pilot = rng.normal(0.0, 1.0, 20)
    pilot = (pilot - pilot.mean()) / pilot.std(ddof=1) + 0.3
    (judgement,) = judged([finding("", partial(mean, pilot.tolist()), 0.0, math.inf)])
    decided = 0
    for _ in range(400):
        sample = rng.normal(0.3, 1.0, int(judgement.seeds_needed)).tolist()
        decided += finding("", partial(mean, sample), 0.0, math.inf).verdict is Verdict.HOLDS
    assert decided / 400 == pytest.approx(0.8, abs=0.06)


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ([], "Not defined in these trials: there is nothing to divide by."),
        ([0.3], "Fewer than 3 seeds give no interval."),
        ([0.3, 0.4], "Fewer than 3 seeds give no interval."),
        ([0.3, 0.3, 0.3], "All seeds give the same number: they show no spread."),
        ([-0.1, 0.0, 0.1], "The 95 % interval holds 0; no number of seeds that can be run would decide it."),
    ],
)
def test_every_inconclusive_claim_says_why(values: list[float], reason: str) -> None:
    found = [finding("it rises", partial(mean, values), 0.0, math.inf, note="A note.")]
    (judgement,) = judged(found)
    assert (judgement.verdict, judgement.reason) == (Verdict.INCONCLUSIVE, f"{reason} A note.")
    (row,) = verdict_table(found).rows
    assert row["reason"] == judgement.reason
    if len(values) < 4 and reason.startswith(("Fewer", "All")):
        (run,) = judged([single_run("it is 0.3", values, 0.3)])
        assert (run.verdict, run.reason) == (Verdict.INCONCLUSIVE, reason)


def test_the_table_has_the_interval_and_p_of_every_verdict() -> None:
    first, second = {seed: 0.1 * seed for seed in range(6)}, {seed: 0.1 * seed + 1.0 for seed in range(6)}
    second[3] += 0.1
    run, rise = (
        single_run("precision is 0.97", RUNS, 0.975, (0.0, 1.0)),
        comparison("it rises", first, second, rises=True),
    )
    table = verdict_table([run, rise])
    one, other = table.flat_rows()
    assert (one["paper"], one["interval_of"], one["verdict"]) == (
        0.975,
        "one further run",
        "within the range of our runs",
    )
    assert (one["low"], one["high"]) == (pytest.approx(0.97 - HALF), 1.0), "no precision is above 1"
    assert one["p_holm"] is None
    assert (other["paper"], other["interval_of"], other["verdict"]) == (None, "the mean", "holds")
    assert (other["holds_above"], other["holds_below"], other["agreeing_seeds"]) == (0.0, None, 6)
    assert float(other["p_holm"] or 1) < 0.001
    assert summary(table) == "Of 2 claims 1 is within the range of our runs, 1 holds (6 seeds)."
    assert lines_by_verdict(table) == {}
    shown = lines_by_verdict(table, everything=True)
    assert shown[Verdict.WITHIN] == [("precision is 0.97", "our runs 0.970 [0.922, 1.000], p 0.79.")]
    assert shown[Verdict.HOLDS][0][1].startswith("1.017 [0.987, 1.177], stated: above 0, so in 6 of 6")


def test_one_or_two_seeds_decide_nothing() -> None:
    for seeds in (1, 2, 3):
        assert is_decided(verdict_table([single_run("", RUNS[:seeds], 0.97)])) == (seeds > 2)


def test_no_word_says_that_a_paper_was_reproduced() -> None:
    assert [verdict.of(2) for verdict in Verdict] == [
        "2 are outside the range of our runs",
        "2 do not hold",
        "2 are inconclusive",
        "2 are within the range of our runs",
        "2 hold",
    ]
