"""How often a 95 % interval holds the truth, for samples shaped like our scores.

Run it as ``python -m benchmarks.coverage [SAMPLES]`` (default 4000 samples a line). ``mean`` and ``share``
are what the tables use; ``before`` is the percentile bootstrap of versions up to 0.1.0, by resampling. What
is printed is ``docs/studies/data/coverage.csv``, percent.
Further runs: how many prediction intervals hold one, and how many such runs lie below and above.
"""

import math
import sys
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from midnet_bench.analysis.statistics import (
    Estimate,
    mean,
    paired_difference,
    prediction,
    ratio_of_sums,
    share,
)

Floats = npt.NDArray[np.float64]
SIZES = (2, 3, 5, 10, 20, 50)
RESAMPLES = 999


def logit_normal(rng: np.random.Generator, shape: tuple[int, int]) -> Floats:
    """A precision near 0.95, skewed to the left."""
    return np.asarray(1.0 / (1.0 + np.exp(-rng.normal(3.0, 0.6, shape))))


def _logit_normal_mean() -> float:
    nodes, weights = np.polynomial.hermite_e.hermegauss(60)
    return float(weights @ (1.0 / (1.0 + np.exp(-(3.0 + 0.6 * nodes)))) / math.sqrt(2.0 * math.pi))


Case = tuple[str, Callable[[np.random.Generator, tuple[int, int]], Floats], float, bool]
CASES: list[Case] = [
    ("normal", lambda rng, shape: rng.normal(0.9, 0.02, shape), 0.9, False),
    (
        "skewed: a duration, lognormal",
        lambda rng, shape: rng.lognormal(0, 0.5, shape),
        math.exp(1 / 8),
        False,
    ),
    (
        "very skewed: lognormal(1)",
        lambda rng, shape: rng.lognormal(0, 1, shape),
        math.exp(1 / 2),
        False,
    ),
    ("skewed: a time to capture, exponential", lambda rng, shape: rng.exponential(1, shape), 1.0, False),
    ("skewed: a precision near 0.95", logit_normal, _logit_normal_mean(), False),
    ("0/1: one intruder, caught at 0.2", lambda rng, shape: rng.binomial(1, 0.2, shape) / 1, 0.2, True),
    ("0/1: one intruder, caught at 0.6", lambda rng, shape: rng.binomial(1, 0.6, shape) / 1, 0.6, True),
    ("shares of three intruders at 0.7", lambda rng, shape: rng.binomial(3, 0.7, shape) / 3, 0.7, True),
    (
        "shares of five, trials unlike, at 0.5",
        lambda rng, shape: rng.binomial(5, rng.beta(2, 2, shape)) / 5,
        0.5,
        True,
    ),
]


def percentile_bootstrap(values: Floats, rng: np.random.Generator) -> tuple[float, float]:
    """The interval of versions up to 0.1.0."""
    means = values[rng.integers(len(values), size=(RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return float(low), float(high)


def held(estimate: Estimate, truth: float) -> float:
    """1 if the interval holds the truth, 0 if not, NaN if there is none."""
    if math.isnan(estimate.low):
        return math.nan
    # sums of the same shares differ in their last digit
    return float(estimate.low - 1e-12 <= truth <= estimate.high + 1e-12)


def percent(marks: list[float]) -> float:
    """The share of intervals that held the truth, of those that there are; NaN where most have none."""
    defined = [mark for mark in marks if not math.isnan(mark)]
    return 100 * sum(defined) / len(defined) if len(defined) > len(marks) / 2 else math.nan


def coverage(case: Case, n: int, samples: int) -> tuple[float, float]:
    """Percent for today's interval and for the earlier one."""
    _, draw, truth, is_share = case
    rng = np.random.default_rng((n, samples))
    values = draw(rng, (samples, n))
    now = [held((share if is_share else mean)(one.tolist()), truth) for one in values]
    before = []
    for one in values[: max(1, samples // 4)]:
        low, high = percentile_bootstrap(one, rng)
        before.append(float(low - 1e-12 <= truth <= high + 1e-12))
    return percent(now), percent(before)


def of_pairs(n: int, samples: int) -> tuple[float, float]:
    """Percent for a paired difference of two precisions, and for a time per capture."""
    rng = np.random.default_rng((n, samples, 2))
    difference, ratio = [], []
    for _ in range(samples):
        hard = rng.normal(3.0, 0.6, n)
        first, second = (1.0 / (1.0 + np.exp(-hard - rng.normal(0.0, 0.2, n))) for _ in range(2))
        difference.append(held(paired_difference(first.tolist(), second.tolist()), 0.0))
        caught = 1 + rng.binomial(4, 0.6, n)
        times = [float(rng.exponential(30.0, count).sum()) for count in caught]
        ratio.append(held(ratio_of_sums(times, caught.tolist()), 30.0))
    return percent(difference), percent(ratio)


def of_rare(n: int, samples: int) -> tuple[float, float]:
    """Percent for a difference that one pair in ten has, by 1; and of samples without any, so no interval."""
    rng = np.random.default_rng((n, samples, 3))
    marks = [held(mean(one.tolist()), 0.1) for one in rng.binomial(1, 0.1, (samples, n)) / 1]
    return 100 * sum(mark == 1.0 for mark in marks) / samples, 100 * sum(map(math.isnan, marks)) / samples


RUNS: list[tuple[str, Callable[[np.random.Generator, tuple[int, int]], Floats]]] = [
    ("a further run: normal", lambda rng, shape: rng.normal(0.9, 0.02, shape)),
    ("beta(95, 5), a precision", lambda rng, shape: rng.beta(95.0, 5.0, shape)),
    ("beta(20, 0.5), nearly all at 1", lambda rng, shape: rng.beta(20.0, 0.5, shape)),
    ("a precision near 0.95, skewed", logit_normal),
    ("clustered counts", lambda rng, shape: rng.poisson(rng.gamma(4.0, 22.0, shape)) / 1999),
    ("lognormal", lambda rng, shape: rng.lognormal(0.0, 0.5, shape)),
    ("exponential", lambda rng, shape: rng.exponential(1.0, shape)),
]


def of_a_further_run(draw: Callable[..., Floats], n: int, samples: int) -> tuple[float, float, float]:
    """Percent of prediction intervals that hold one further run, and that it lies below and above."""
    inside, below, above = 0, 0, 0
    for *ours, theirs in draw(np.random.default_rng((n, samples, 4)), (samples, n + 1)).tolist():
        run = prediction(ours, theirs).run
        below, above = below + (theirs < run.low), above + (theirs > run.high)
        inside += run.low <= theirs <= run.high
    return 100 * inside / samples, 100 * below / samples, 100 * above / samples


def main(samples: int) -> None:
    print("sample,n,samples,held,held_before,without_interval,below,above")
    for n in SIZES:
        for case in CASES:
            now, before = coverage(case, n, samples)
            print(f'"{case[0]}",{n},{samples},{now},{before},,,', flush=True)
        difference, ratio = of_pairs(n, samples)
        print(f"a paired difference of precisions,{n},{samples},{difference},,,,")
        print(f'"a time per capture, sum over sum",{n},{samples},{ratio},,,,')
        found, none = of_rare(n, samples)
        print(f"a difference that one pair in ten has,{n},{samples},{found},,{none},,")
        for name, draw in RUNS:
            if n > 2:
                held_run, below, above = of_a_further_run(draw, n, samples)
                print(f'"{name}",{n},{samples},{held_run},,,{below},{above}', flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 4000)
