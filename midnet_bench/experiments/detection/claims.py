"""What sections IV.C and V.A state that a number can judge, each against a detection campaign."""

import math
from collections.abc import Callable
from functools import partial

import pandas as pd

from midnet_bench.analysis.claims import Finding, comparison, finding
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import Estimate, mean, ratio_of_sums
from midnet_bench.experiments.columns import CAUSES
from midnet_bench.experiments.detection.counting import PAPER, PAPER_FRAMES, SCORES
from midnet_bench.experiments.detection.tables import by_seed, cells_of, score_over_seeds

TOLERANCE = 0.05
"""how near a mean counts as the paper's"""
COUNT_TOLERANCE = 0.10
"""how near a count per frame does, as a share of the paper's"""
MINOR = 0.10
"""the most that a cause "not expected to be significant" may have of the errors"""
NEVER = 0.01
"""the share of frames below which something counts as not happening"""

RISES = {"recall": True, "precision": False, "f1": True, "fp": True, "fn": False, "fn_hidden": False}
"""column of the scores -> whether it rises from one robot to five, in the paper's words or table"""

ONE, FIVE = PAPER


def claims(results: Results) -> list[Finding]:
    """The paper's table, which team is ahead in it, the causes that it names, its words on the fused list."""
    cells = cells_of(results)
    has_causes = all(set(CAUSES) <= set(cell) for cell in cells.values())  # not up to version 0.1.0
    found = []
    for name in PAPER:
        if name in cells:
            found += [*_scores(name, cells[name]), *_counts(name, cells[name])]
            found += _delay(name, cells[name]) if has_causes else []
    if PAPER.keys() <= cells.keys():
        one, five = cells[ONE], cells[FIVE]
        found += [
            _change(one, five, column, rises)
            for column, rises in RISES.items()
            if column in one and column in five
        ]
    if has_causes and ONE in cells:
        statement = f"{ONE}: most misses are of hidden intruders (share)"
        found.append(finding(statement, _share(cells[ONE], "fn_hidden", "fn"), 0.5, math.inf))
    if has_causes and FIVE in cells:
        found += _fused_list(cells[FIVE])
    return found


def _scores(name: str, cell: pd.DataFrame) -> list[Finding]:
    """The three ratios of one team."""
    found = []
    for score in SCORES:
        value = float(PAPER[name][score] or 0.0)
        statement = f"{name} {score} is {value:.3f}, within {TOLERANCE}"
        ours = partial(score_over_seeds, cell, score)
        found.append(finding(statement, ours, value - TOLERANCE, value + TOLERANCE))
    return found


def _counts(name: str, cell: pd.DataFrame) -> list[Finding]:
    """The three counts of one team, per frame (item 41)."""
    found = []
    for count in ("tp", "fp", "fn"):
        value = float(PAPER[name][count] or 0.0) / PAPER_FRAMES
        statement = f"{name} {count} per frame is {value:.3f}, within {COUNT_TOLERANCE:.0%}"
        ours = partial(mean, (cell[count] / cell["frames"]).tolist(), within=(0.0, math.inf))
        found.append(
            finding(statement, ours, (1.0 - COUNT_TOLERANCE) * value, (1.0 + COUNT_TOLERANCE) * value)
        )
    return found


def _delay(name: str, cell: pd.DataFrame) -> list[Finding]:
    """What "is not expected to be significant": misses just come near, false boxes where one just was."""
    return [
        finding(
            f"{name}: few {error} are of the scan's delay (share)",
            _share(cell, part, error),
            -math.inf,
            MINOR,
        )
        for error, part in (("fp", "fp_left"), ("fn", "fn_new"))
    ]


def _fused_list(cell: pd.DataFrame) -> list[Finding]:
    """Section IV.C.2 on the result of Algorithms 3 and 4 (item 35)."""
    overlapping = _share(cell, "overlapping", "frames")
    reordered = _share(cell, "reordered", "looked_at")
    return [
        finding(f"{FIVE}: no two fused boxes overlap (share of frames)", overlapping, -math.inf, NEVER),
        finding(f"{FIVE}: the robots' order does not matter (share of frames)", reordered, -math.inf, NEVER),
    ]


def _change(one: pd.DataFrame, five: pd.DataFrame, column: str, rises: bool) -> Finding:
    """Seed by seed; counts are per frame."""
    per_frame = column not in SCORES
    first, second = (
        by_seed(
            cell.assign(**{column: cell[column] / cell["frames"]})
            if per_frame
            else cell.dropna(subset=[column]),
            column,
        )
        for cell in (one, five)
    )
    what = f"{column} per frame" if per_frame else column
    return comparison(f"{what} {'rises' if rises else 'falls'} from 1 to 5 robots", first, second, rises)


def _share(cell: pd.DataFrame, part: str, whole: str) -> Callable[[float], Estimate]:
    """Sum over sum, over seeds."""
    return lambda confidence: ratio_of_sums(cell[part].tolist(), cell[whole].tolist(), confidence)
