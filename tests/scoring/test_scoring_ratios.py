import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from midnet_bench.scoring.frame_counts import f1, precision, ratios, recall

COUNTS = st.integers(0, 10**6)


@pytest.mark.parametrize(
    ("tp", "fp", "fn", "printed"),
    [(6967, 176, 1889, ("0.975", "0.787", "0.871")), (14953, 1047, 619, ("0.935", "0.960", "0.947"))],
    ids=["1-robot", "5-robot"],
)
def test_the_papers_table(tp: int, fp: int, fn: int, printed: tuple[str, str, str]) -> None:
    assert tuple(f"{ratio:.3f}" for ratio in ratios(tp, fp, fn)) == printed


def test_undefined_ratios_are_nan() -> None:
    assert math.isnan(precision(0, 0))
    assert math.isnan(recall(0, 0))
    # something to find, nothing found, no box: recall is 0, the rest is undefined
    p, r, f = ratios(0, 0, 5)
    assert (math.isnan(p), r, math.isnan(f)) == (True, 0.0, True)
    # false boxes only: both are 0, and Eq. 10 divides by 0
    p, r, f = ratios(0, 3, 5)
    assert (p, r, math.isnan(f)) == (0.0, 0.0, True)


@given(COUNTS, COUNTS, COUNTS)
def test_ratios_lie_within_0_and_1_and_f1_between_the_other_two(tp: int, fp: int, fn: int) -> None:
    p, r, f = ratios(tp, fp, fn)
    for ratio in (p, r, f):
        assert math.isnan(ratio) or 0.0 <= ratio <= 1.0
    if tp > 0:
        assert min(p, r) * (1 - 1e-12) <= f <= max(p, r) * (1 + 1e-12)
        assert f == pytest.approx(2 * tp / (2 * tp + fp + fn))
    else:
        assert math.isnan(f)


def test_f1_is_the_harmonic_mean() -> None:
    assert f1(0.5, 1.0) == pytest.approx(2 / 3)
    assert f1(0.0, 1.0) == 0.0
