"""Precision, recall and F1 of summed counts; an undefined ratio is NaN."""

import math
from typing import NamedTuple


class Ratios(NamedTuple):
    """The three scores of the paper's table, 0 to 1 or NaN."""

    precision: float
    recall: float
    f1: float


def precision(tp: float, fp: float) -> float:
    """Eq. 8, tp / (tp + fp); NaN when there was no box."""
    return _share(tp, fp)


def recall(tp: float, fn: float) -> float:
    """Eq. 9, tp / (tp + fn); NaN when there was nothing to find."""
    return _share(tp, fn)


def f1(precision: float, recall: float) -> float:
    """Eq. 10, the harmonic mean of the two; NaN when either is, or when both are 0 (item 40)."""
    if math.isnan(precision) or math.isnan(recall) or precision + recall == 0.0:
        return math.nan
    return 2.0 * precision * recall / (precision + recall)


def ratios(tp: float, fp: float, fn: float) -> Ratios:
    """Eqs. 8 to 10 of counts that are already summed over frames.

    For the one-to-one matching give ``matched``, ``fp + duplicates`` and ``missed``.
    """
    p, r = precision(tp, fp), recall(tp, fn)
    return Ratios(p, r, f1(p, r))


def _share(part: float, rest: float) -> float:
    return part / (part + rest) if part + rest > 0 else math.nan
