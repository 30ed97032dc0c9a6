"""The figure of a mapping campaign: time, coverage and walls over the size of the team, a row per arena."""

from collections.abc import Mapping
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate
from midnet_bench.drawing.charts import FONT_PT, STYLES, Style, add_estimates, chart, light_grid
from midnet_bench.drawing.plots import own_style
from midnet_bench.experiments.mapping.tables import ENOUGH_COVERAGE, Maps, mean_of, rows_of

DODGE = 0.1
SPREAD = 0.12
"""over which the single trials of a team are drawn side by side, in robots"""


class Points(NamedTuple):
    """One measure of one team."""

    trials: list[float]
    mean: Estimate


Teams = Mapping[int, Mapping[str, Points]]
"""team size -> measure -> its numbers"""


def figures(results: Results) -> dict[str, Figure]:
    """The figure of a mapping campaign, ``mapping``."""
    maps = rows_of(results, "maps")
    return {"mapping": mapping_figure(points_of(maps))} if maps else {}


def points_of(maps: Maps) -> dict[str, Teams]:
    """What is drawn: arena -> team size -> measure -> each trial's value and their mean."""
    measures = ("time_s", "coverage", "occupied_precision", "occupied_recall")
    return {
        arena: {
            robots: {name: Points(trials[name].tolist(), mean_of(trials, name)) for name in measures}
            for robots, trials in teams.items()
        }
        for arena, teams in maps.items()
    }


@own_style()
def mapping_figure(arenas: Mapping[str, Teams]) -> Figure:
    """Each trial as a dot, each team's mean with its 95 % interval over seeds."""
    figure = chart(10.5, 0.5 + 3.1 * len(arenas), w_pad=0.1, h_pad=0.1)
    panels = figure.subplots(len(arenas), 3, squeeze=False)
    for (arena, teams), (time, coverage, walls) in zip(arenas.items(), panels, strict=True):
        _draw(time, teams, "time_s", STYLES[0])
        time.set_ylim(bottom=0.0)
        time.set_ylabel("time until no frontier is left (s)", fontsize=FONT_PT)
        _draw(coverage, teams, "coverage", STYLES[0])
        coverage.axhline(ENOUGH_COVERAGE, color="#888888", linewidth=0.8, linestyle=(0, (4, 3)))
        coverage.set_ylabel("free space covered (share)", fontsize=FONT_PT)
        coverage.set_ylim(top=1.0 + 0.03 * (1.0 - coverage.get_ylim()[0]))
        _draw(walls, teams, "occupied_precision", STYLES[1], -DODGE, "precision")
        _draw(walls, teams, "occupied_recall", STYLES[2], DODGE, "recall")
        walls.set_ylabel("occupied cells, within one cell", fontsize=FONT_PT)
        walls.legend(fontsize=FONT_PT - 1, frameon=False)
        for axes in (time, coverage, walls):
            axes.set_title(arena, fontsize=FONT_PT, loc="left")
            axes.set_xlabel("robots that explore", fontsize=FONT_PT)
            axes.set_xticks(sorted(teams))
            light_grid(axes)
            axes.tick_params(labelsize=FONT_PT - 1)
    figure.supxlabel(
        f"a dot is a trial; {MEAN_METHOD}, over seeds",
        fontsize=FONT_PT - 2,
        color="#555555",
    )
    return figure


def _draw(
    axes: Axes, teams: Teams, measure: str, style: Style, shift: float = 0.0, label: str | None = None
) -> None:
    """One measure over the size of the team, moved sideways by ``shift`` robots."""
    for robots, points in teams.items():
        values = points[measure].trials
        steps = [(k + 0.5) / len(values) - 0.5 for k in range(len(values))]
        xs = [robots + shift + SPREAD * step for step in steps]
        axes.plot(xs, values, ".", color=style.color, alpha=0.35, markersize=4)
    means = [points[measure].mean for points in teams.values()]
    add_estimates(axes, [robots + shift for robots in teams], means, style, label)
