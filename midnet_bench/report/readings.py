"""What each reading of the paper's gaps moves, from the store of a ``readings`` campaign."""

import math
from collections.abc import Sequence
from pathlib import Path

from midnet_bench.campaign.store import Store
from midnet_bench.experiments.trial import Row
from midnet_bench.report.detection import PAPER, SCORES
from midnet_bench.report.tables import Table
from midnet_bench.rng import stream
from midnet_bench.scoring import statistics
from midnet_bench.scoring.ratios import ratios

Scored = dict[tuple[str, str], dict[str, statistics.Estimate]]
"""(reading, trial name) -> score -> its mean over seeds"""


def write_readings_report(store: Store, directory: Path) -> list[Table]:
    """Write ``readings``: a row per reading, the six means and how far from the paper's; best first."""
    rows = sorted(_rows(_scored(store)), key=_distance)
    table = Table("Readings, nearest to the paper's table first", rows)
    table.write(directory / "readings_table")
    return [table]


def _scored(store: Store) -> Scored:
    by_seed: dict[tuple[str, str], list[Row]] = {}
    for trial in store.trials():
        if trial.status == "finished":
            cell = store.definition.cell_of(trial.parameters)
            others = "".join(f" {key}={value}" for key, value in cell.items() if key != "robots")
            for row in trial.tables["readings"]:
                key = (f"{row['reading']}{others}", f"{trial.parameters['robots']}-robot")
                by_seed.setdefault(key, []).append(row)
    return {key: _means(rows) for key, rows in by_seed.items()}


def _means(rows: Sequence[Row]) -> dict[str, statistics.Estimate]:
    scored = [ratios(*(int(row[key] or 0) for key in ("tp", "fp", "fn")))._asdict() for row in rows]
    return {
        name: statistics.mean([one[name] for one in scored], stream(0, "bootstrap", name)) for name in SCORES
    }


def _rows(scored: Scored) -> list[Row]:
    rows: list[Row] = []
    for reading in dict.fromkeys(name for name, _ in scored):
        row: Row = {"reading": reading}
        gaps = []
        for trial, paper in PAPER.items():
            for score in SCORES:
                mean = scored[reading, trial][score].value if (reading, trial) in scored else math.nan
                row[f"{score} {trial[0]}"] = mean
                gaps.append(abs(mean - float(paper[score] or 0.0)))
        rows.append(
            {**row, "largest gap": max(gaps), "rms gap": math.sqrt(sum(g * g for g in gaps) / len(gaps))}
        )
    return rows


def _distance(row: Row) -> float:
    gap = row["rms gap"]
    return gap if isinstance(gap, float) and not math.isnan(gap) else math.inf
