"""``python -m benchmarks.sequential_coverage``: how often the sequential test's interval holds the truth.

Each line has a threshold, a true probability, the share of 2000 repetitions whose interval holds it, the
share of wrong decisions, and the trials that they took in the mean. What is printed is
``docs/studies/data/sequential-coverage.csv``.
"""

from functools import cache

import numpy as np

from midnet_bench.analysis.sample_size import BATCH, SequentialTest

REPETITIONS, MOST, SEED = 2000, 400, 1
THRESHOLDS = (0.5, 0.8, 0.9, 0.95)
TRUTHS = (0.3, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.88, 0.9, 0.92, 0.95)


def measure(threshold: float, truth: float, rng: np.random.Generator) -> tuple[float, float, float]:
    """Coverage, share of wrong decisions, mean trials."""
    test = SequentialTest(threshold, MOST)
    interval = cache(test.interval)
    held, wrong, taken = 0, 0, 0
    for _ in range(REPETITIONS):
        successes = np.cumsum(rng.random(MOST) < truth)[BATCH - 1 :: BATCH].tolist()
        ends = zip(successes, range(BATCH, MOST + 1, BATCH), strict=True)
        end = next(end for end in ends if test.is_over(*end))
        decision, found = test.decision(*end), interval(*end)
        held += found.low <= truth <= found.high
        wrong += decision is not None and decision != (truth > threshold)
        taken += end[1]
    return held / REPETITIONS, wrong / REPETITIONS, taken / REPETITIONS


def main() -> None:
    """Print the table."""
    rng = np.random.default_rng(SEED)
    print("threshold,truth,repetitions,held,wrong,trials")
    for threshold in THRESHOLDS:
        for truth in TRUTHS:
            print(threshold, truth, REPETITIONS, *measure(threshold, truth, rng), sep=",", flush=True)


if __name__ == "__main__":
    main()
