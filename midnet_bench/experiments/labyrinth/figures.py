"""The labyrinth's figures: the paper's last one, with intervals, and how its points came about."""

import io
from collections.abc import Callable, Mapping, Sequence
from itertools import cycle
from math import ceil
from typing import NamedTuple

from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator

from midnet_bench.analysis.statistics import Estimate
from midnet_bench.experiments.labyrinth.tables import not_caught, success
from midnet_bench.experiments.labyrinth.trials import (
    GUARD,
    INTRUDER,
    Cells,
    LabyrinthTrial,
    RobotHealth,
    intruder_counts,
    mean,
    number,
    pooled_time,
    seed_means,
    team_sizes,
)

DPI = 200
DODGE = 0.07
"""between neighbouring series, in security robots, so that intervals do not cover each other"""
FONT_PT = 9


class Style(NamedTuple):
    """Colour, marker and dash each tell the series apart alone: for colour-blind readers and grey print."""

    color: str
    marker: str
    dash: str | tuple[int, tuple[float, ...]]


STYLES = (
    Style("#0072B2", "o", "-"),
    Style("#D55E00", "s", "--"),
    Style("#009E73", "^", "-."),
    Style("#CC79A7", "D", ":"),
    Style("#000000", "v", (0, (5, 1, 1, 1, 1, 1))),
)
"""Okabe and Ito's colours"""

Point = Callable[[int], Estimate]
"""team size -> what is drawn there"""


def success_figure(variants: Mapping[str, Cells]) -> Figure:
    """Mean success rate over team size, a line per number of intruders; a panel per variant."""
    columns = min(2, len(variants))
    figure = _figure(6.0 * columns, 4.0 * ceil(len(variants) / columns))
    for place, (name, cells) in enumerate(variants.items(), 1):
        axes = figure.add_subplot(ceil(len(variants) / columns), columns, place)
        _by_intruders(axes, cells, lambda intruders, robots, cells=cells: success(cells, intruders, robots))  # type: ignore[misc]
        axes.set_ylim(-3, 103)
        axes.set_ylabel("success rate (%)")
        axes.set_title(name, fontsize=FONT_PT + 1)
        _note(axes, f"{_trials_per_point(cells)} trials per point, 95 % bootstrap intervals over trials")
    figure.legend(*_labelled(figure.axes[0]), fontsize=FONT_PT, frameon=False, loc="outside right upper")
    return figure


def details_figure(cells: Cells) -> Figure:
    """Time to capture, detected but not caught, and how the robots drove, over team size."""
    figure = _figure(10.0, 6.0)
    panels = [figure.add_subplot(2, 3, place) for place in range(1, 6)]
    _by_intruders(panels[0], cells, lambda k, q: pooled_time(cells.get((k, q), ()), "capture_times_s"))
    panels[0].set_ylabel("time to capture (s)")
    _by_intruders(panels[1], cells, lambda k, q: not_caught(cells, k, q))
    panels[1].set_ylabel("detected but not caught (%)")
    healths: list[tuple[str, Callable[[RobotHealth], float]]] = [
        ("driven (m per minute)", lambda robot: robot.metres_per_minute),
        ("time stuck (%)", lambda robot: robot.stuck_percent),
        ("goals given up per robot", lambda robot: number(robot.row["goals_given_up"])),
    ]
    for axes, (label, value) in zip(panels[2:], healths, strict=True):
        points: list[tuple[str, Point]] = [
            (f"{role}s", _health_point(cells, role, value)) for role in (GUARD, INTRUDER)
        ]
        _lines(axes, team_sizes(cells), points)
        axes.set_ylabel(label)
    for axes in panels:
        top = 1.08 * axes.dataLim.y1 if axes.dataLim.y1 > 0.0 else 1.0
        axes.set_ylim(-0.03 * top, top)
    legend = figure.add_subplot(2, 3, 6)
    legend.set_axis_off()
    upper = legend.legend(*_labelled(panels[0]), fontsize=FONT_PT, frameon=False, loc="upper left")
    legend.add_artist(upper)
    legend.legend(*_labelled(panels[2]), fontsize=FONT_PT, frameon=False, loc="lower left")
    return figure


def png_and_svg(figure: Figure) -> dict[str, bytes]:
    """The figure's files by ending; the same figure gives the same bytes."""
    files = {}
    # without a salt the ids in an SVG are random
    with rc_context({"svg.hashsalt": "midnet-bench"}):
        for ending, metadata in ((".png", {"Software": None}), (".svg", {"Date": None})):
            buffer = io.BytesIO()
            figure.savefig(buffer, format=ending[1:], dpi=DPI, metadata=metadata)
            files[ending] = buffer.getvalue()
    return files


def _health_point(cells: Cells, role: str, value: Callable[[RobotHealth], float]) -> Point:
    def of_trial(trial: LabyrinthTrial) -> float:
        return trial.mean_health(role, value)

    return lambda robots: mean(list(seed_means(cells, robots, of_trial).values()), "health", role, robots)


def _by_intruders(axes: Axes, cells: Cells, estimate: Callable[[int, int], Estimate]) -> None:
    points: list[tuple[str, Point]] = [
        (f"{count} intruder{'s' if count > 1 else ''}", lambda robots, count=count: estimate(count, robots))  # type: ignore[misc]
        for count in intruder_counts(cells)
    ]
    _lines(axes, team_sizes(cells), points)


def add_estimates(
    axes: Axes, places: Sequence[float], estimates: Sequence[Estimate], style: Style, label: str | None
) -> None:
    """A line through estimates at places along x, each with its interval as a bar."""
    axes.errorbar(
        places,
        [e.value for e in estimates],
        yerr=[[e.value - e.low for e in estimates], [e.high - e.value for e in estimates]],
        label=label,
        color=style.color,
        marker=style.marker,
        linestyle=style.dash,
        markersize=5,
        linewidth=1.3,
        elinewidth=0.8,
        capsize=2,
    )


def _lines(axes: Axes, sizes: Sequence[int], series: Sequence[tuple[str, Point]]) -> None:
    for place, ((label, point), style) in enumerate(zip(series, cycle(STYLES))):
        shift = DODGE * (place - (len(series) - 1) / 2)
        places = [robots + shift for robots in sizes]
        add_estimates(axes, places, [point(robots) for robots in sizes], style, label)
    axes.set_xlabel("security robots")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(axis="y", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _trials_per_point(cells: Cells) -> str:
    counts = {len(trials) for trials in cells.values()}
    return "-".join(str(n) for n in dict.fromkeys((min(counts), max(counts))))


def _labelled(axes: Axes) -> tuple[list[Artist], list[str]]:
    handles, labels = axes.get_legend_handles_labels()
    return handles, labels


def _note(axes: Axes, text: str) -> None:
    axes.text(
        1.0,
        -0.14,
        text,
        transform=axes.transAxes,
        fontsize=FONT_PT - 2,
        color="#555555",
        horizontalalignment="right",
        verticalalignment="top",
    )


def _figure(width_in: float, height_in: float) -> Figure:
    figure = Figure(figsize=(width_in, height_in), layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.08))
    FigureCanvasAgg(figure)
    return figure
