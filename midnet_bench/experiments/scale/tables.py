"""What the number of robots does to duplicates, and to what their order changes."""

import math
from collections.abc import Mapping

import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.experiments.detection.counting import with_boxes
from midnet_bench.experiments.detection.tables import by_seed
from midnet_bench.experiments.experiment import Measures

MOST = {
    "f1_one_to_one": 1.0,
    "gospa_per_intruder_m": math.inf,
    "duplicates_per_intruder": math.inf,
    "overlapping_share": 1.0,
    "reordered_share": 1.0,
}
"""the scores, and the greatest value that each can have"""


def tables(results: Results) -> list[Table]:
    """``scale``: a row for each cell."""
    rows: list[Mapping[str, Cell]] = []
    for name, cell in _cells(results).items():
        scores = {
            score: statistics.mean(cell[score].tolist(), within=(0.0, most)) for score, most in MOST.items()
        }
        per_frame = sum(cell["found"]) / sum(cell["frames"])
        rows.append({"trial": name, "seeds": len(cell), "found_per_frame": per_frame, **scores})
    title = f"Fusion of large teams ({statistics.MEAN_METHOD}, over seeds)"
    return [
        Table(
            "scale",
            title,
            rows,
            {"found_per_frame": 1},
            beside=("seeds", "found_per_frame", "overlapping_share", "gospa_per_intruder_m"),
        )
    ]


def measures(results: Results) -> Measures:
    """Each score of each cell by seed."""
    return {(name, score): by_seed(cell, score) for name, cell in _cells(results).items() for score in MOST}


def _cells(results: Results) -> Mapping[str, pd.DataFrame]:
    """The finished trials by cell, with their scores."""
    frame = results.table("scenes")
    if frame.empty:
        return {}
    frame = with_boxes(results, frame)
    frame = frame.assign(
        duplicates_per_intruder=frame["duplicates"] / frame["intruders_in_range"],
        overlapping_share=frame["overlapping"] / frame["boxes"],
        reordered_share=frame["reordered"] / frame["orders"],
        gospa_per_intruder_m=frame["gospa_m"] / frame["intruders_in_range"],
    )
    names = pd.Series(results.teams(frame), frame.index)
    cells = frame.drop(columns=results.factors).groupby(names, sort=False)
    return {str(name): cell for name, cell in cells}
