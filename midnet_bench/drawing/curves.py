"""Scores over a numeric factor: a line of means with its band, a dot for each trial."""

from collections.abc import Mapping
from itertools import cycle
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate
from midnet_bench.drawing.charts import FONT_PT, STYLES, Style, chart, labelled, light_grid
from midnet_bench.drawing.plots import own_style

Means = Mapping[str, Mapping[float, Estimate]]
Trials = Mapping[str, Mapping[float, Mapping[int, float]]]


@own_style()
def curves_figure(x: str, trials: Mapping[str, Trials], means: Mapping[str, Means]) -> Figure:
    """A panel for each score, with a line for each curve.

    Args:
        x: what stands along the axis.
        trials: score -> curve -> place along x -> seed -> value; each is a dot.
        means: score -> curve -> place along x -> the mean over seeds and its interval, the band.
    """
    columns = min(2, len(means))
    rows = ceil(len(means) / columns)
    figure = chart(5.2 * columns, 3.4 * rows)
    for place, (score, curves) in enumerate(means.items(), 1):
        axes = figure.add_subplot(rows, columns, place)
        for (label, points), style in zip(curves.items(), cycle(STYLES)):
            _add_curve(axes, points, trials[score][label], style, label)
        axes.set_xlabel(x)
        axes.set_ylabel(score)
        light_grid(axes)
    handles, labels = labelled(figure.axes[0])
    if any(labels) and len(labels) > 1:
        figure.legend(handles, labels, fontsize=FONT_PT, frameon=False, loc="outside right upper")
    counts = [estimate.n for curves in means.values() for one in curves.values() for estimate in one.values()]
    seeds = "-".join(map(str, sorted({min(counts), max(counts)})))
    figure.supxlabel(
        f"line: mean of {seeds} trials; dot: a trial; band: {MEAN_METHOD}",
        fontsize=FONT_PT - 2,
        color="#555555",
    )
    return figure


def _add_curve(
    axes: Axes,
    points: Mapping[float, Estimate],
    trials: Mapping[float, Mapping[int, float]],
    style: Style,
    label: str,
) -> None:
    """One line, its band and its dots."""
    at = np.array(list(points))
    values, lows, highs = (np.array([one[part] for one in points.values()]) for part in range(3))
    axes.fill_between(at, lows, highs, color=style.color, alpha=0.18, linewidth=0)
    axes.plot(
        at,
        values,
        color=style.color,
        marker=style.marker,
        linestyle=style.dash,
        markersize=4,
        linewidth=1.3,
        label=label,
    )
    dots = np.array([(place, value) for place, seeds in trials.items() for value in seeds.values()])
    axes.scatter(dots[:, 0], dots[:, 1], s=7, color=style.color, alpha=0.45, linewidths=0, zorder=1.5)
