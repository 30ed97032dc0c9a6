"""What a campaign's further metrics came to."""

from collections.abc import Mapping

from midnet_bench.analysis import statistics
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.experiments.experiment import Measures

NAME = "metrics_summary"


def metric_measures(results: Results) -> Measures:
    """Each metric of each cell by seed, in the campaign's order; nothing where no metric was asked for."""
    frame = results.tables.get("metrics")
    if frame is None or frame.empty:
        return {}
    found: dict[tuple[str, str], dict[int, float]] = {}
    columns = (frame[name].tolist() for name in ("metric", "value", "seed"))
    for cell, metric, value, seed in zip(results.teams(frame), *columns, strict=True):
        found.setdefault((cell, metric), {})[seed] = value
    return found


def metric_tables(results: Results) -> list[Table]:
    """A row for each metric of each cell: the mean over seeds and its interval; no table without metrics."""
    rows: list[Mapping[str, Cell]] = [
        {"trial": cell, "metric": metric, "value": statistics.mean(list(by_seed.values()))}
        for (cell, metric), by_seed in metric_measures(results).items()
    ]
    return [Table(NAME, f"Further metrics ({statistics.MEAN_METHOD}, over seeds)", rows)] if rows else []
