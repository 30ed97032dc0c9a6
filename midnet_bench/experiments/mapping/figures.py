"""The figure of a mapping campaign: time, coverage and walls over the size of the team, a row per arena."""

from matplotlib.figure import Figure

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import MEAN_METHOD
from midnet_bench.drawing.charts import Panel, panel_figure
from midnet_bench.experiments.mapping.tables import ENOUGH_COVERAGE, mean_of, teams_of

PANELS = {  # label of an axis -> label of a line -> column of ``maps``
    "time until no frontier is left, s": {"": "time_s"},
    "free space covered, share": {"": "coverage"},
    "occupied cells, within one cell": {"precision": "occupied_precision", "recall": "occupied_recall"},
}


def figures(results: Results) -> dict[str, Figure]:
    """``mapping``: each trial as a dot, each team's mean with its 95 % interval over seeds."""
    maps, panels = teams_of(results, "maps"), []
    for arena in dict.fromkeys(arena for arena, _ in maps):
        teams = {size: trials for (place, size), trials in maps.items() if place == arena}
        for label, lines in PANELS.items():
            is_coverage, is_time = ("coverage" in lines.values(), "time_s" in lines.values())
            panels.append(
                Panel(
                    label,
                    {name: {q: mean_of(teams[q], column) for q in teams} for name, column in lines.items()},
                    arena,
                    (0.0 if is_time else None, 1.002 if is_coverage else None),
                    {name: {q: teams[q][column].tolist() for q in teams} for name, column in lines.items()},
                    [(ENOUGH_COVERAGE, "#888888")] if is_coverage else (),
                )
            )
    title = "Maps by size of the team"
    return {"mapping": panel_figure(panels, "robots that explore", title, MEAN_METHOD, 3)} if panels else {}
