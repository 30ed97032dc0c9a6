"""Where detections are lost: a trial's errors by cause, with an example of each."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby

from midnet_bench.page.recording import COLUMNS, KINDS, Recording
from midnet_bench.scoring.error_causes import FALSE_CAUSES, MISS_CAUSES

MISSES, FALSE_BOXES = "misses", "false boxes"
MEANINGS: Mapping[str, Mapping[str, str]] = {MISSES: MISS_CAUSES, FALSE_BOXES: FALSE_CAUSES}
"""a side of the funnel -> cause -> what it means"""
KIND, CAUSE, GUARD, WHO = (COLUMNS["errors"].index(name) for name in ("kind", "cause", "guard", "who"))


@dataclass(frozen=True)
class Example:
    """A place in a trial at which a cause is seen."""

    trial: int
    """place of the trial on the page"""
    frame: int
    """counted from 1"""
    frames: int
    """how long the same error lasts"""


@dataclass
class Funnel:
    """The errors of recorded trials, which :meth:`add` counts."""

    counts: Counter[tuple[str, str, str]] = field(default_factory=Counter)
    """(side, cause, cell) -> errors"""
    examples: dict[tuple[str, str], Example] = field(default_factory=dict)
    """(side, cause) -> where it lasts longest"""
    cells: list[str] = field(default_factory=list)

    def add(self, recording: Recording, trial: int) -> None:
        """Count a trial's errors; ``trial``: its place on the page."""
        if recording.cell not in self.cells:
            self.cells.append(recording.cell)
        runs: dict[tuple[str, str, int, int], list[int]] = {}
        for frame, errors in enumerate(recording.frames["errors"], 1):
            for error in errors:
                side = MISSES if KINDS[error[KIND]] == "miss" else FALSE_BOXES
                cause = recording.words[error[CAUSE] - 1]
                self.counts[side, cause, recording.cell] += 1
                runs.setdefault((side, cause, error[GUARD], error[WHO]), []).append(frame)
        for (side, cause, _, _), frames in runs.items():
            found = _longest_run(frames)
            known = self.examples.get((side, cause))
            if known is None or found[1] > known.frames:
                first, length = found
                # in its middle the cause is plainest
                self.examples[side, cause] = Example(trial, first + length // 2, length)

    def total(self, side: str, cell: str, cause: str | None = None) -> int:
        """How many errors a cell has, of a cause if one is given."""
        return sum(
            count
            for (of_side, of_cause, of_cell), count in self.counts.items()
            if of_side == side and of_cell == cell and cause in (None, of_cause)
        )

    def causes(self, side: str) -> list[str]:
        """Those that occur, the commonest first."""
        totals: Counter[str] = Counter()
        for (of_side, cause, _), count in self.counts.items():
            totals[cause] += count if of_side == side else 0
        return [cause for cause, count in totals.most_common() if count]


def _longest_run(frames: Sequence[int]) -> tuple[int, int]:
    """First frame and length of the longest unbroken run in ascending frames."""
    distinct = sorted(set(frames))
    runs = [
        [frame for _, frame in run]
        for _, run in groupby(enumerate(distinct), key=lambda one: one[1] - one[0])
    ]
    longest = max(runs, key=len)
    return longest[0], len(longest)
