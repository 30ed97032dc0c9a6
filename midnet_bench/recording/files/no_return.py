"""What a driver writes where no beam came back, and what each such number means.

REP 117 says: inf, nothing came back; -inf, too near; nan, a void reading. Many drivers write nan, 0, a number
below the least range, or the largest range instead. What it means decides whether its beam clears marks.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.recording.files.readings import Floats, ScanReading

Meaning = Literal["clears", "nothing"]
MEANINGS: dict[str, Meaning] = {"clears": "clears", "nothing": "nothing", "invalid": "nothing"}
"""what key ``no_return`` may say of a code; an invalid reading says nothing"""

CODES = ("inf", "nan", "zero", "below", "above")
"""above: at or beyond the largest range; below: from 0 to the least range; zero: 0 or less, -inf too"""
_WORDS = {
    "inf": "inf",
    "nan": "nan",
    "zero": "0 or less",
    "below": "below range_min",
    "above": "range_max or more",
}
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
        said = np.array([math.inf if self.meaning[code] == "clears" else math.nan for code in CODES])
        return np.where(kinds < 0, scan.ranges_m, said[kinds])

    @property
    def in_words(self) -> str:
        """``no return: inf 12.3 % (clears), nan 0.1 % (says nothing)``."""
        said = {"clears": "clears", "nothing": "says nothing"}
        parts = [
            f"{_WORDS[code]} {share:.1%} ({said[self.meaning[code]]})"
            for code, share in self.shares.items()
            if share > 0.0
        ]
        return ", ".join(parts) if parts else "none"


def _kinds(scan: ScanReading, range_max_m: float) -> npt.NDArray[np.int64]:
    """(beams,) the place in ``CODES`` of each reading, -1 for a range."""
    ranges, most_m = scan.ranges_m, min(range_max_m, scan.range_max_m)
    is_code = (
        ranges == math.inf,
        np.isnan(ranges),
        ranges <= 0.0,
        ranges < scan.range_min_m,
        ranges >= most_m,
    )
    return np.select(is_code, range(len(CODES)), -1)


def found_in(scans: Sequence[ScanReading], given: Mapping[str, Meaning]) -> NoReturn:
    """How a driver says that nothing came back, from some of its scans.

    inf and a reading at or beyond the largest range clear. Where there is neither, the most frequent of nan,
    0 and one number below the least range is the code, if it is not rare. All else says nothing.

    Args:
        scans: of one topic, at least one with a beam.
        given: meanings of codes by the user, which count.
    """
    highest_m = _ceiling(scans)
    kinds = np.concatenate([np.empty(0), *(_kinds(scan, highest_m) for scan in scans)])
    ranges = np.concatenate([np.empty(0), *(scan.ranges_m for scan in scans)])
    shares = {code: int(np.count_nonzero(kinds == k)) / max(len(kinds), 1) for k, code in enumerate(CODES)}
    meaning: dict[str, Meaning] = dict.fromkeys(CODES, "nothing")
    meaning["inf"] = meaning["above"] = "clears"
    candidates = {"nan": shares["nan"], "zero": shares["zero"]}
    near = ranges[kinds == CODES.index("below")]
    if len(near) and np.unique(near, return_counts=True)[1].max() >= SAME_VALUE * len(near):
        candidates["below"] = shares["below"]
    if max(shares["inf"], shares["above"]) < LEAST_SHARE:
        code, share = max(candidates.items(), key=lambda one: one[1])
        if share >= LEAST_SHARE:
            meaning[code] = "clears"
    return NoReturn(shares, {**meaning, **given}, highest_m)


def _ceiling(scans: Sequence[ScanReading]) -> float:
    """The largest range that these scans have, or the largest reading if many have exactly that one."""
    range_max_m = max((scan.range_max_m for scan in scans), default=math.inf)
    ranges = np.concatenate([scan.ranges_m for scan in scans]) if scans else np.empty(0)
    finite = ranges[np.isfinite(ranges)]
    if not len(finite):
        return range_max_m
    largest_m = float(finite.max())
    piled = np.count_nonzero(finite >= largest_m - 1e-6)
    is_code = largest_m < range_max_m and piled >= max(PILED_SHARE * len(ranges), 10)
    return largest_m if is_code else range_max_m
