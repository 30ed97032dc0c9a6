"""What sections IV.C and V.A state that a number can judge, each against a detection campaign."""

import math
from collections.abc import Callable, Mapping
from functools import partial

import pandas as pd

from midnet_bench.analysis.claims import Claim, Finding, comparison, findings
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import Estimate, mean, ratio_of_sums
from midnet_bench.experiments.detection.tables import (
    COUNTS,
    PAPER,
    PAPER_FRAMES,
    SCORES,
    Trials,
    cells_of,
    paper_of,
)

TOLERANCE = 0.05  # how near a mean counts as the paper's
COUNT_TOLERANCE = 0.10  # how near a count per frame does, as a share of the paper's
MINOR = 0.10  # the most that a cause "not expected to be significant" may have of the errors
NEVER = 0.01  # the share of frames below which something counts as not happening

RISES = {  # column of the scores -> whether it rises from one robot to five, in the paper's words or table
    "recall": True,
    "precision": False,
    "f1": True,
    "fp": True,
    "fn": False,
    "fn_hidden": False,
    "fn_hidden_in_window": False,
}
TEAMS = dict(zip(PAPER, ("1 robot", "5 robots"), strict=True))
ONE, FIVE = PAPER
CALLED = {  # column of the scores -> its words
    "f1": "F1",
    "tp": "true positives",
    "fp": "false positives",
    "fn": "misses",
    "fn_hidden": "misses of hidden intruders",
    "fn_hidden_in_window": "misses of hidden intruders inside the local costmaps",
}
MISSES = {  # which misses are judged -> columns: how many, how many of them hidden, how many new
    "": ("fn", "fn_hidden", "fn_new"),
    " inside the local costmaps": ("fn_in_window", "fn_hidden_in_window", "fn_new_in_window"),
}


def claims(results: Results) -> list[Finding]:
    """The paper's table, which team is ahead in it, the causes that it names, its words on the fused list.

    Causes of misses are judged twice: over all misses, and over those of intruders that a local costmap
    reaches, since the paper does not say how large its local costmap is. Nothing is judged of a campaign in
    another arena than the paper's.
    """
    if not paper_of(results.definition):
        return []
    cells = {
        team: cell.rows.assign(fn_in_window=cell.rows["fn"] - cell.rows["fn_outside_window"])
        for team, cell in cells_of(results).items()
    }
    tables, found, causes = list[Claim](), list[Finding](), list[Claim]()
    for team in PAPER:
        if team in cells:
            tables += _table(TEAMS[team], PAPER[team], cells[team])
            tables += _delay(TEAMS[team], cells[team])
    if PAPER.keys() <= cells.keys():
        found = [_change(cells[ONE], cells[FIVE], column, rises) for column, rises in RISES.items()]
    if ONE in cells:
        for which, (misses, hidden, _) in MISSES.items():
            claim = f"1 robot: most misses{which} are hidden intruders"
            causes.append(Claim(claim, _share(cells[ONE], hidden, misses), 0.5, math.inf))
    if FIVE in cells:  # section IV.C.2 on the result of Algorithms 3 and 4 (item 35)
        most = f"in at most {100 * NEVER:.0f} % of the frames"
        for claim, part, whole in (
            ("fused boxes overlap", "overlapping", "frames"),
            ("the order of the robots changes the boxes", "reordered", "looked_at"),
        ):
            share = _share(cells[FIVE], part, whole)
            causes.append(Claim(f"5 robots: {claim} {most}", share, -math.inf, NEVER))
    return [*findings(tables), *found, *findings(causes)]


def _table(team: str, paper: Mapping[str, float], rows: pd.DataFrame) -> list[Claim]:
    """The three ratios of one team, and its three counts per frame (item 41)."""
    found = []
    for score in SCORES:
        value = paper[score]
        claim = f"{team}: {CALLED.get(score, score)} is {value:.3f}, within {TOLERANCE}"
        # no score is above 1: what would lie there accepts all that is high enough
        below = value + TOLERANCE if value + TOLERANCE <= 1.0 else math.inf
        ours = partial(mean, rows[score].tolist(), within=(0.0, 1.0))
        found.append(Claim(claim, ours, value - TOLERANCE, below))
    for count in COUNTS:
        value = paper[count] / PAPER_FRAMES
        claim = f"{team}: a frame has {value:.3f} {CALLED[count]}, within {100 * COUNT_TOLERANCE:.0f} %"
        ours = partial(mean, (rows[count] / rows["frames"]).tolist(), within=(0.0, math.inf))
        found.append(Claim(claim, ours, (1.0 - COUNT_TOLERANCE) * value, (1.0 + COUNT_TOLERANCE) * value))
    return found


def _delay(team: str, cell: pd.DataFrame) -> list[Claim]:
    """What "is not expected to be significant": misses just come near, false boxes where one just was."""
    shares = {"false positives": ("fp_left", "fp")}
    shares |= {f"misses{which}": (new, misses) for which, (misses, _, new) in MISSES.items()}
    return [
        Claim(
            f"{team}: at most {100 * MINOR:.0f} % of the {errors} are due to scan delay",
            _share(cell, part, whole),
            -math.inf,
            MINOR,
        )
        for errors, (part, whole) in shares.items()
    ]


def _change(one: pd.DataFrame, five: pd.DataFrame, column: str, rises: bool) -> Finding:
    """Seed by seed; counts are per frame."""
    is_count = column not in SCORES
    first, second = (
        Trials(
            cell.assign(**{column: cell[column] / cell["frames"]})
            if is_count
            else cell.dropna(subset=[column])
        ).by_seed(column)
        for cell in (one, five)
    )
    what, verb = CALLED.get(column, column), "rise" if rises else "fall"
    claim = f"{what} per frame {verb}" if is_count else f"{what} {verb}s"
    within = (0.0, math.inf) if is_count else (0.0, 1.0)
    return comparison(f"{claim} from 1 robot to 5", first, second, rises, within)


def _share(cell: pd.DataFrame, part: str, whole: str) -> Callable[[float], Estimate]:
    """Sum over sum, over seeds."""
    return partial(ratio_of_sums, cell[part].tolist(), cell[whole].tolist(), within=(0.0, 1.0))
