"""What a driver writes where no beam came back, and what each such number means.

REP 117 says: inf, nothing came back; -inf, too near; nan, a void reading. Many drivers write nan, 0, a number
below the least range, or the largest range instead. What it means decides whether its beam clears marks.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Floats
from midnet_bench.recording.files.readings import ScanReading

Meaning = Literal["clears", "nothing"]
CODES = {
    "inf": "inf",
    "nan": "nan",
    "zero": "0 or less",
    "below": "below range_min",
    "above": "range_max or more",
}
"""code -> which readings have it, the first that fits; -inf is ``zero``"""
LEAST_SHARE = 0.002
"""of all beams: what is rarer is a fault of a reading, and not how the driver says that nothing came back"""
SAME_VALUE = 0.9
"""of the readings below the least range: so many of one value are a code, else they are near things"""
PILED_SHARE = 0.02
"""of all beams that have one and the same value, the largest: that is the driver's largest range"""


class NoReturn(NamedTuple):
    """How the scans of one topic are to be read."""

    shares: dict[str, float]  # code -> of all beams
    meaning: dict[str, Meaning]  # code -> what it says
    range_max_m: float  # as the scans have it, or less where readings pile up below it

    def cleaned(self, scan: ScanReading) -> Floats:
        """(beams,) the ranges, metres: inf where nothing came back, nan where the reading says nothing."""
        kinds = _kinds(scan, self.range_max_m)
        cleaned = np.array([math.inf if self.meaning[code] == "clears" else math.nan for code in CODES])
        return np.where(kinds < 0, scan.ranges_m, cleaned[kinds])

    @property
    def in_words(self) -> str:
        """``inf 12.3 % (clears), nan 0.1 % (says nothing)``."""
        meanings = {"clears": "clears", "nothing": "says nothing"}
        parts = [
            f"{CODES[code]} {share:.1%} ({meanings[self.meaning[code]]})"
            for code, share in self.shares.items()
            if share > 0.0
        ]
        return ", ".join(parts) or "none"


def _kinds(scan: ScanReading, range_max_m: float) -> npt.NDArray[np.int64]:
    """(beams,) the place in ``CODES`` of each reading, -1 for a range."""
    ranges, most_m = scan.ranges_m, min(range_max_m, scan.range_max_m)
    is_zero, is_below, is_above = ranges <= 0.0, ranges < scan.range_min_m, ranges >= most_m
    is_code = (ranges == math.inf, np.isnan(ranges), is_zero, is_below, is_above)
    return np.select(is_code, range(len(CODES)), -1)


def found_in(scans: Sequence[ScanReading], given: Mapping[str, Meaning]) -> NoReturn:
    """How a driver says that nothing came back, from some of its scans.

    inf and a reading at or beyond the largest range clear. Where there is neither, the most frequent of nan,
    0 and one number below the least range is the code, if it is not rare. All else says nothing.

    Args:
        scans: of one topic.
        given: meanings of codes by the user, which count.
    """
    ranges = np.concatenate([np.empty(0), *(scan.ranges_m for scan in scans)])
    range_max_m = max((scan.range_max_m for scan in scans), default=math.inf)
    finite = ranges[np.isfinite(ranges)]
    largest_m = float(finite.max(initial=-math.inf))
    piled = np.count_nonzero(finite >= largest_m - 1e-6)
    if largest_m < range_max_m and piled >= max(PILED_SHARE * len(ranges), 10):
        range_max_m = largest_m
    kinds = np.concatenate([np.empty(0), *(_kinds(scan, range_max_m) for scan in scans)])
    shares = {code: int(np.count_nonzero(kinds == k)) / max(len(kinds), 1) for k, code in enumerate(CODES)}
    meaning: dict[str, Meaning] = {**dict.fromkeys(CODES, "nothing"), "inf": "clears", "above": "clears"}
    candidates = ["nan", "zero"]
    _, counts = np.unique(ranges[kinds == list(CODES).index("below")], return_counts=True)
    if counts.max(initial=0) >= SAME_VALUE * max(counts.sum(), 1):
        candidates.append("below")
    code = max(candidates, key=shares.__getitem__)
    if max(shares["inf"], shares["above"]) < LEAST_SHARE <= shares[code]:
        meaning[code] = "clears"
    return NoReturn(shares, {**meaning, **given}, range_max_m)
