"""What each reading of the paper's gaps moves, from the store of a ``readings`` campaign."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.store import Store
from midnet_bench.campaign.trial import Row
from midnet_bench.experiments.detection.tables import PAPER, SCORES
from midnet_bench.scoring.ratios import ratios

HEADINGS = {"precision": "P", "recall": "R", "f1": "F1"}
NOISE, FALSE = "noise per 200", "false per 200"
"""False boxes per 200 frames without intruders: of one guard, where only noise causes any; of a team."""
FRAMES = 200

Runs = Mapping[str, Mapping[tuple[bool, str], Sequence[Row]]]
"""reading -> (whether intruders were there, trial name) -> its rows, one per seed"""


def write_readings_report(store: Store, directory: Path) -> list[Table]:
    """Write ``readings_table``: a row per reading, ranked as section IV.A and the paper's table ask.

    Six means over seeds as in the paper's table, the largest and the root mean square of their gaps to it,
    and, where the campaign ran an arena without intruders, false boxes per 200 of its frames. First come the
    readings under which a guard alone there sees nothing (IV.A: thresh is tuned until sensor noise makes no
    false positive); of those the nearest to the table; of equally near ones (to a hundredth, which is what
    the seeds tell apart) the one with the fewest false boxes.
    """
    rows = [_row(reading, cells) for reading, cells in _runs(store).items()]
    table = Table("Readings, nearest to the paper's table first", sorted(rows, key=_rank))
    table.write(directory / "readings_table")
    return [table]


def _runs(store: Store) -> Runs:
    runs: dict[str, dict[tuple[bool, str], list[Row]]] = {}
    for trial in store.trials():
        if trial.status != "finished":
            continue
        cell = store.definition.cell_of(trial.parameters)
        others = "".join(f" {key}={value}" for key, value in cell.items() if key not in ("robots", "arena"))
        for row in trial.tables["readings"]:
            has_intruders = bool(row["has_intruders"])
            key = (has_intruders, f"{trial.parameters['robots']}-robot")
            runs.setdefault(f"{row['reading']}{others}", {}).setdefault(key, []).append(row)
    return runs


def _row(reading: str, cells: Mapping[tuple[bool, str], Sequence[Row]]) -> Row:
    row: Row = {"reading": reading}
    gaps = []
    for name, paper in PAPER.items():
        scored = [ratios(*_counts(one))._asdict() for one in cells.get((True, name), ())]
        for score in SCORES:
            mean = sum(one[score] for one in scored) / len(scored) if scored else math.nan
            row[f"{HEADINGS[score]}({name[0]})"] = mean
            gaps.append(abs(mean - float(paper[score] or 0.0)))
    row["largest gap"] = max(gaps)
    row["rms gap"] = math.sqrt(sum(gap * gap for gap in gaps) / len(gaps))
    empty = {name: rows for (has_intruders, name), rows in cells.items() if not has_intruders}
    if empty:
        row[NOISE] = _false_per_200(empty.get("1-robot", ()))
        row[FALSE] = max(_false_per_200(rows) for rows in empty.values())
    return row


def _false_per_200(rows: Sequence[Row]) -> float:
    frames = sum(int(row["frames"] or 0) for row in rows)
    return FRAMES * sum(_counts(row)[1] for row in rows) / frames if frames else math.nan


def _counts(row: Row) -> tuple[int, int, int]:
    return int(row["tp"] or 0), int(row["fp"] or 0), int(row["fn"] or 0)


def _rank(row: Row) -> tuple[bool, float, float]:
    gap, noise, false = (float(row.get(key) or 0.0) for key in ("rms gap", NOISE, FALSE))
    return noise > 0.0, math.inf if math.isnan(gap) else round(gap, 2), false
