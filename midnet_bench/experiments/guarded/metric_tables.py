"""What a campaign's further metrics came to."""

from collections.abc import Mapping

import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.compare import MEASURE, label, series
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.tables import Cell, Table

NAME = "metrics_summary"
METRICS = "metrics"  # the table of trials that take some


def metric_measures(results: Results) -> pd.DataFrame:
    """Each metric of each trial, a frame of scores in the campaign's order; empty without metrics."""
    frame = results.tables.get(METRICS)
    if frame is None or frame.empty:
        return pd.DataFrame()
    frame = frame.assign(robots=results.column(frame, "robots")).rename(columns={"metric": MEASURE})
    return frame[[*dict.fromkeys([*results.factors, "robots"]), "seed", MEASURE, "value"]]


def metric_tables(results: Results) -> list[Table]:
    """A row for each metric of each cell: the mean over seeds and its interval; no table without metrics."""
    frame = metric_measures(results)
    names = [str(name) for name in frame if name not in (MEASURE, "seed", "value")]
    rows: list[Mapping[str, Cell]] = [
        {
            "trial": label(names, key[:-1]),
            "metric": str(key[-1]),
            "value": statistics.mean([*values.values()]),
        }
        for key, values in (series(frame, [*names, MEASURE]) if names else {}).items()
    ]
    return [Table(NAME, f"Further metrics ({statistics.MEAN_METHOD}, over seeds)", rows)] if rows else []
