"""The figure of a mapping campaign: time, coverage and walls over the size of the team, a row per arena."""

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from midnet_bench.campaign.trial import Row
from midnet_bench.experiments.labyrinth.figures import FONT_PT, STYLES, Style, add_estimates
from midnet_bench.experiments.labyrinth.trials import number
from midnet_bench.experiments.mapping.tables import ENOUGH_COVERAGE, Maps, mean_of

DODGE = 0.1
SPREAD = 0.12
"""over which the single trials of a team are drawn side by side, in robots"""


def mapping_figure(maps: Maps) -> Figure:
    """Each trial as a dot, each team's mean with its 95 % interval over seeds."""
    figure = Figure(
        figsize=(10.5, 0.5 + 3.1 * len(maps)), layout=ConstrainedLayoutEngine(w_pad=0.1, h_pad=0.1)
    )
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(maps), 3, squeeze=False)
    for (arena, teams), (time, coverage, walls) in zip(maps.items(), panels, strict=True):
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
            axes.grid(axis="y", color="#dddddd", linewidth=0.6)
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
            axes.tick_params(labelsize=FONT_PT - 1)
    figure.supxlabel(
        "a dot is a trial; means with 95 % bootstrap intervals over seeds",
        fontsize=FONT_PT - 2,
        color="#555555",
    )
    return figure


def _draw(
    axes: Axes,
    teams: Mapping[int, Sequence[Row]],
    measure: str,
    style: Style,
    shift: float = 0.0,
    label: str | None = None,
) -> None:
    """One measure over the size of the team, moved sideways by ``shift`` robots."""
    for robots, trials in teams.items():
        steps = [(k + 0.5) / len(trials) - 0.5 for k in range(len(trials))]
        places = [robots + shift + SPREAD * step for step in steps]
        values = [number(one[measure]) for one in trials]
        axes.plot(places, values, ".", color=style.color, alpha=0.35, markersize=4)
    means = [mean_of(trials, measure) for trials in teams.values()]
    add_estimates(axes, [robots + shift for robots in teams], means, style, label)
