"""Scores under each value of a factor that is no number: points side by side, the baseline across them."""

from collections.abc import Mapping, Sequence
from itertools import cycle

import numpy as np
from matplotlib.figure import Figure

from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate
from midnet_bench.drawing.charts import (
    FONT_PT,
    STYLES,
    add_estimates,
    chart,
    counted,
    labelled,
    light_grid,
)
from midnet_bench.drawing.labels import axis_label
from midnet_bench.drawing.plots import own_style

DODGE = 0.16
"""between neighbouring cells, in values"""


@own_style()
def values_figure(
    values: Sequence[str], means: Mapping[str, Mapping[str, Mapping[str, Estimate]]], what: str
) -> Figure:
    """A panel for each score below each other, with points for each cell.

    Args:
        values: along x, the baseline first; its means go across the panel in grey.
        means: score -> cell -> value -> the mean over seeds and its interval.
        what: the factor, for the title.
    """
    figure = chart(0.32 * len(values) + 2.2, 2.2 * len(means) + 1.2, h_pad=0.03)
    places = {value: place for place, value in enumerate(values)}
    for row, (score, cells) in enumerate(means.items(), 1):
        axes = figure.add_subplot(len(means), 1, row)
        for number, ((cell, points), style) in enumerate(zip(cells.items(), cycle(STYLES))):
            if values[0] in points:
                baseline = points[values[0]].value
                axes.axhline(baseline, color="#999999", linewidth=0.8, linestyle=style.dash, zorder=1)
            shift = DODGE * (number - (len(cells) - 1) / 2)
            at = [places[value] + shift for value in points]
            add_estimates(axes, at, list(points.values()), style._replace(dash="none"), cell)
        axes.set_xticks(np.arange(len(values)), values if row == len(means) else [""] * len(values))
        axes.tick_params(axis="x", labelrotation=60, labelsize=FONT_PT - 2)
        for text in axes.get_xticklabels():
            text.set(horizontalalignment="right", rotation_mode="anchor")
        axes.set_ylabel(axis_label(score))
        light_grid(axes)
    handles, labels = labelled(figure.axes[0])
    each = [one for cells in means.values() for points in cells.values() for one in points.values()]
    figure.legend(
        handles,
        labels,
        fontsize=FONT_PT,
        frameon=False,
        loc="outside upper left",
        ncols=len(labels),
        title=f"Scores by {what}: {counted(each, MEAN_METHOD)}; grey: {values[0]}",
        title_fontsize=FONT_PT,
        alignment="left",
    )
    return figure
