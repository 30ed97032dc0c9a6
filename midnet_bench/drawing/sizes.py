"""The figures of ``size``: probability over time by team size, and where intruders start."""

from collections.abc import Mapping, Sequence
from itertools import cycle

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from midnet_bench.drawing.charts import FONT_PT, STYLES, chart, light_grid, own_style
from midnet_bench.drawing.scene import Floats

LABELLED = 12
"""so many places at most have their share beside them"""


@own_style()
def times_figure(
    times_s: Mapping[int, Sequence[float]], within_s: float, probability: float, done: str
) -> Figure:
    """The share of trials in which the intruder was found by each time, a step line for each team size.

    Args:
        times_s: team size -> a time for each trial, NaN if it was not found.
        within_s: where the time ends.
        probability: the threshold, a grey line.
        done: ``found`` or ``caught``.
    """
    figure = chart(5.6, 3.6)
    axes = figure.add_subplot()
    for (robots, times), style in zip(times_s.items(), cycle(STYLES)):
        at = np.sort([time for time in times if not np.isnan(time)])
        shares = np.arange(len(at) + 1) / len(times)
        x, y = [0.0, *at.tolist(), within_s], [*shares.tolist(), shares[-1]]
        label = f"{robots} guard{'s' * (robots != 1)}, {len(times)} trials"
        axes.step(x, y, where="post", color=style.color, linestyle=style.dash, linewidth=1.4, label=label)
    axes.axhline(probability, color="#999999", linewidth=0.8)
    axes.set(xlim=(0.0, within_s), ylim=(0.0, 1.02), xlabel="time since the intruder entered, s")
    axes.set_ylabel(f"intruders {done}, share of trials")
    axes.legend(fontsize=FONT_PT - 1, frameon=False, loc="best")
    light_grid(axes)
    return figure


@own_style()
def entrances_figure(
    walls: Sequence[Floats], places: pd.DataFrame, robots: int, within_s: float, done: str
) -> Figure:
    """The building with a dot for each start of an intruder, coloured by how long the guards took.

    Args:
        walls: outlines, (n, 2) each, metres.
        places: ``x_m``, ``y_m``, ``share``, ``median_s``, ``trials`` of each.
        robots: the team's size.
        within_s: the end of the colours' scale; places where most are not found are red crosses.
        done: ``found`` or ``caught``.
    """
    corners = np.concatenate(list(walls))
    low, high = corners.min(axis=0) - 0.4, corners.max(axis=0) + 0.4
    width, height = high - low
    figure = chart(6.4, max(2.4, min(8.0, 5.2 * height / width)))
    axes = figure.add_subplot()
    for outline in walls:
        axes.add_patch(Polygon(outline, facecolor="#444444", edgecolor="none"))
    late, few = places["median_s"].isna(), len(places) <= LABELLED
    dots = axes.scatter(
        places["x_m"][~late], places["y_m"][~late], c=places["median_s"][~late], s=60 if few else 22,
        cmap="viridis", vmin=0.0, vmax=within_s, edgecolors="white", linewidths=0.5, zorder=3,
    )  # fmt: skip
    axes.scatter(places["x_m"][late], places["y_m"][late], c="#D55E00", marker="x", s=45, zorder=3)
    for x, y, share in zip(places["x_m"], places["y_m"], places["share"], strict=True):
        if few:
            text = f"{100 * share:.0f} %"
            axes.annotate(text, (x, y), xytext=(6, 6), textcoords="offset points", fontsize=FONT_PT)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x, m", ylabel="y, m")
    guards = f"{robots} guard{'s' * (robots != 1)}"
    axes.set_title(f"When {guards} have {done} an intruder that starts here", fontsize=FONT_PT)
    label = f"median time, s (cross: most not within {within_s:g} s)"
    figure.colorbar(dots, ax=axes, label=label, shrink=0.8)
    return figure
