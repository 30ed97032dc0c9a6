"""Scores over the values of a factor: means with their intervals, a dot for each trial."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate
from midnet_bench.drawing.charts import STYLES, Panel, panel_figure
from midnet_bench.drawing.labels import axis_label

Means = Mapping[str, Mapping[float, Estimate]]
Trials = Mapping[str, Mapping[float, Mapping[int, float]]]


def curves_figure(
    x: str,
    trials: Mapping[str, Trials],
    means: Mapping[str, Means],
    ranges: Mapping[str, tuple[float, float]],
) -> Figure:
    """A panel for each score, with a line for each curve over a numeric factor.

    Args:
        x: label of the axis.
        trials: score -> curve -> place along x -> seed -> value; each is a dot.
        means: score -> curve -> place along x -> the mean over seeds and its interval, the bar.
        ranges: score -> the least and the greatest value that it can have; one in 0 to 1 has that axis.
    """
    panels = []
    for score, curves in means.items():
        limits = (0.0 if ranges[score][0] == 0.0 else None, 1.03 if ranges[score] == (0.0, 1.0) else None)
        dots = {
            label: {place: [*seeds.values()] for place, seeds in points.items()}
            for label, points in trials[score].items()
        }
        panels.append(Panel(axis_label(score), curves, limits=limits, trials=dots))
    return panel_figure(panels, x, f"Scores by {x}", MEAN_METHOD, 3 if len(means) > 4 else 2)


def values_figure(
    values: Sequence[str], means: Mapping[str, Mapping[str, Mapping[str, Estimate]]], what: str
) -> Figure:
    """A panel for each score below each other, with points for each cell over a factor's values.

    Args:
        values: along x, the baseline first; its means go across the panel.
        means: score -> cell -> value -> the mean over seeds and its interval.
        what: the factor, for the title.
    """
    panels = [
        Panel(
            axis_label(score),
            cells,
            levels=[
                (points[values[0]].value, style.color)
                for points, style in zip(cells.values(), STYLES, strict=False)
                if values[0] in points
            ],
        )
        for score, cells in means.items()
    ]
    return panel_figure(panels, what, f"Scores by {what}", MEAN_METHOD, 1, note=f"lines: {values[0]}")
