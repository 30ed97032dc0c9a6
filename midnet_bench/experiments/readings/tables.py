"""What each reading of the paper's gaps moves, from the results of a ``readings`` campaign."""

import math
from collections.abc import Mapping

import pandas as pd

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.experiments.detection.tables import PAPER, SCORES
from midnet_bench.scoring.frame_counts import ratios

HEADINGS = {"precision": "P", "recall": "R", "f1": "F1"}
NOISE, FALSE = "noise_per_200_frames", "false_per_200_frames"
"""False boxes per 200 frames without intruders: of one guard, where only noise causes any; of a team."""
FRAMES = 200


def tables(results: Results) -> list[Table]:
    """``readings_table``: a row per reading, ranked as section IV.A and the paper's table ask.

    Six means over seeds as in the paper's table, the largest and the root mean square of their gaps to it,
    and, where the campaign ran an arena without intruders, false boxes per 200 of its frames. First come the
    readings under which a guard alone there sees nothing (IV.A: thresh is tuned until sensor noise makes no
    false positive); of those the nearest to the table; of equally near ones (to a hundredth, which is what
    the seeds tell apart) the one with the fewest false boxes.
    """
    frame = results.table("readings")
    rows = []
    if not frame.empty:
        others = results.others(frame, "robots", "arena", separator=" ")
        names = [" ".join(filter(None, pair)) for pair in zip(frame["reading"], others, strict=True)]
        teams = frame.assign(team=[f"{size}-robot" for size in results.column(frame, "robots")])
        rows = [
            _row(str(name), runs) for name, runs in teams.groupby(pd.Series(names, frame.index), sort=False)
        ]
    title = "Readings by RMS gap to the paper's table; gaps equal to 0.01 are ties, fewest false boxes first"
    return [Table("readings_table", title, sorted(rows, key=_rank))]


def _row(reading: str, runs: pd.DataFrame) -> dict[str, Cell]:
    """One reading's scores, from its rows of all teams and seeds."""
    row: dict[str, Cell] = {"reading": reading}
    has_intruders = runs["has_intruders"].astype(bool)
    gaps = []
    for team, paper in PAPER.items():
        seen = runs[has_intruders & (runs["team"] == team)]
        scored = [ratios(*counts)._asdict() for counts in seen[["tp", "fp", "fn"]].to_numpy().tolist()]
        for score in SCORES:
            mean = sum(one[score] for one in scored) / len(scored) if scored else math.nan
            row[f"{HEADINGS[score]}({team[0]})"] = mean
            gaps.append(abs(mean - float(paper[score] or 0.0)))
    row["largest gap"] = max(gaps)
    row["rms gap"] = math.sqrt(sum(gap * gap for gap in gaps) / len(gaps))
    empty = {team: _false_per_200(one) for team, one in runs[~has_intruders].groupby("team", sort=False)}
    if empty:
        row[NOISE] = empty.get("1-robot", math.nan)
        row[FALSE] = max(empty.values())
    return row


def _false_per_200(runs: pd.DataFrame) -> float:
    frames = sum(runs["frames"])
    return FRAMES * sum(runs["fp"]) / frames if frames else math.nan


def _rank(row: Mapping[str, Cell]) -> tuple[bool, float, float]:
    gap, noise, false = (float(row.get(key) or 0.0) for key in ("rms gap", NOISE, FALSE))  # type: ignore[arg-type]
    return noise > 0.0, math.inf if math.isnan(gap) else round(gap, 2), false
