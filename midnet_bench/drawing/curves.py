"""Scores over a numeric factor: a line of means with their intervals, a dot for each trial."""

from collections.abc import Mapping
from itertools import cycle
from math import ceil

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate
from midnet_bench.drawing.charts import (
    FONT_PT,
    STYLES,
    Style,
    add_estimates,
    chart,
    counted,
    labelled,
    light_grid,
)
from midnet_bench.drawing.labels import axis_label
from midnet_bench.drawing.plots import own_style

Means = Mapping[str, Mapping[float, Estimate]]
Trials = Mapping[str, Mapping[float, Mapping[int, float]]]


@own_style()
def curves_figure(
    x: str,
    trials: Mapping[str, Trials],
    means: Mapping[str, Means],
    ranges: Mapping[str, tuple[float, float]],
) -> Figure:
    """A panel for each score, with a line for each curve.

    Args:
        x: label of the axis.
        trials: score -> curve -> place along x -> seed -> value; each is a dot.
        means: score -> curve -> place along x -> the mean over seeds and its interval, the bar.
        ranges: score -> the least and the greatest value that it can have; one in 0 to 1 has that axis.
    """
    columns = min(3 if len(means) > 4 else 2, len(means))
    rows = ceil(len(means) / columns)
    figure = chart(4.2 * columns, 3.0 * rows)
    places = sorted({at for curves in means.values() for one in curves.values() for at in one})
    gap = min(np.diff(places), default=1.0)
    for place, (score, curves) in enumerate(means.items(), 1):
        axes = figure.add_subplot(rows, columns, place)
        for number, ((label, points), style) in enumerate(zip(curves.items(), cycle(STYLES))):
            shift = 0.06 * gap * (number - (len(curves) - 1) / 2)
            _add_curve(axes, points, trials[score][label], style, label, shift)
        if ranges[score] == (0.0, 1.0):
            axes.set_ylim(0.0, 1.03)
        elif ranges[score][0] == 0.0:
            axes.set_ylim(bottom=0.0)
        if all(at == int(at) for at in places):
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel(x)
        axes.set_ylabel(axis_label(score))
        light_grid(axes)
    handles, labels = labelled(figure.axes[0])
    if any(labels) and len(labels) > 1:
        figure.legend(handles, labels, fontsize=FONT_PT, frameon=False, loc="outside right upper")
    each = [e for curves in means.values() for one in curves.values() for e in one.values()]
    figure.suptitle(f"Scores by {x}", fontsize=FONT_PT + 2, x=0.01, ha="left")
    figure.supxlabel(
        f"{counted(each, MEAN_METHOD)}; dot: a trial",
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
    shift: float,
) -> None:
    """One line with its bars, and its dots; ``shift`` along x keeps bars apart."""
    add_estimates(axes, [at + shift for at in points], list(points.values()), style, label)
    dots = np.array([(place + shift, value) for place, seeds in trials.items() for value in seeds.values()])
    axes.scatter(dots[:, 0], dots[:, 1], s=7, color=style.color, alpha=0.45, linewidths=0, zorder=1.5)
