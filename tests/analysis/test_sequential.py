import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.sequential_coverage import measure
from midnet_bench.analysis import sample_size
from midnet_bench.analysis.sample_size import ALPHA, BATCH, SequentialTest


def test_the_likelihood_ratio_is_that_of_the_mixture() -> None:
    """Against a numerical integral over Jeffreys' prior."""
    threshold, successes, trials = 0.8, 60, 80
    p = (np.arange(400_000) + 0.5) / 400_000
    prior = 1.0 / (math.pi * np.sqrt(p * (1.0 - p)))
    mixed = np.mean(prior * p**successes * (1.0 - p) ** (trials - successes))
    ratio = mixed / (threshold**successes * (1.0 - threshold) ** (trials - successes))
    assert SequentialTest(threshold, 400)._log_ratio(successes, trials) == pytest.approx(
        math.log(ratio), abs=1e-3
    )


@pytest.mark.parametrize(
    ("successes", "trials", "expected"), [(120, 120, True), (30, 120, False), (108, 120, None)]
)
def test_clear_trials_decide_and_others_do_not(successes: int, trials: int, expected: bool | None) -> None:
    assert SequentialTest(0.9, 400).decision(successes, trials) is expected


def test_the_ways_to_end_are_those_of_all_sequences(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of the 2**12 sequences of trials, followed one by one."""
    monkeypatch.setattr(sample_size, "BATCH", 4)
    test, p = SequentialTest(0.6, 12), 0.7
    expected: dict[tuple[int, int], float] = {}
    for sequence in itertools.product((0, 1), repeat=12):
        for stage in (1, 2, 3):
            successes = sum(sequence[: 4 * stage])
            if test.is_over(successes, 4 * stage):
                chance = math.prod(p if one else 1.0 - p for one in sequence)
                expected[stage, successes] = expected.get((stage, successes), 0.0) + chance
                break
    ends = test._ends
    keys = zip(ends.stages.tolist(), ends.successes.tolist(), strict=True)
    assert dict(zip(keys, ends.probabilities(p).tolist(), strict=True)) == pytest.approx(expected)


def test_without_an_early_end_the_interval_is_the_mid_p_one() -> None:
    """By the binomial distribution, at a threshold that no trials decide."""
    test = SequentialTest(0.5, 40)
    found = test.interval(22, 40)

    def tail(p: float, successes: range) -> float:
        each = [math.comb(40, k) * p**k * (1.0 - p) ** (40 - k) for k in successes]
        return sum(each) - 0.5 * math.comb(40, 22) * p**22 * (1.0 - p) ** 18

    assert tail(found.low, range(22, 41)) == pytest.approx(ALPHA / 2.0, rel=1e-6)
    assert tail(found.high, range(23)) == pytest.approx(ALPHA / 2.0, rel=1e-6)


@pytest.mark.slow
@settings(max_examples=25)
@given(st.floats(0.05, 0.95), st.integers(0, 400), st.integers(0, 399))
def test_an_interval_holds_its_share_and_grows_with_it(threshold: float, first: int, seed: int) -> None:
    test = SequentialTest(threshold, 400)
    successes = np.cumsum(np.random.default_rng(seed).random(400) < first / 400)
    for trials in range(BATCH, 401, BATCH):
        if test.is_over(int(successes[trials - 1]), trials):
            break
    found = test.interval(int(successes[trials - 1]), trials)
    assert 0.0 <= found.low <= found.high <= 1.0
    assert (found.low == 0.0) == (successes[trials - 1] == 0)


@pytest.mark.slow
@pytest.mark.parametrize("truth", [0.75, 0.85, 0.92])
def test_intervals_hold_the_truth_in_95_of_100_repetitions(truth: float) -> None:
    held, wrong, _ = measure(0.9, truth, np.random.default_rng(3))
    assert 0.93 <= held <= 0.97
    assert wrong <= ALPHA
