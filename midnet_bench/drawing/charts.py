"""Charts of numbers by matplotlib, Agg only: no window, no global state."""

import contextlib
import io
from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle
from math import ceil, isfinite
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib import rc_context, rcParamsDefault
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

from midnet_bench.analysis.statistics import MEAN_METHOD, SHARE_METHOD, Estimate
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats

DPI, FONT_PT = 200, 9
DODGE = 0.08  # between neighbouring series, as a share of the gap between places along x
ENDS = 0.03  # between the bars behind the end of a time axis, as a share of it
LABELLED = 12  # so many entrances at most have their share beside them
METADATA: Mapping[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
"""format of a figure -> what is left out of its file, or its bytes would differ"""
FORMATS = ("png", "svg")  # written unless other formats are given
LONGEST = 44  # characters of an explanation that fits an axis
AXIS_LABELS = {
    "f1": "F1",
    "f1_one_to_one": "F1, one-to-one",
    "gospa_per_frame_m": "GOSPA, m per frame",
    "robots": "security robots",
    "intruders": "intruders",
    "frames": "frames",
    "caught_percent": "intruders caught, %",
    "success_rate": "success rate, %",
    "local_size_m": "local costmap's side, m",
    "obstacle_range_m": "usable LiDAR range, m",
    "thresh_local": "thresh of Eq. 1, local costmap",
    "thresh_global": "thresh of Eq. 1, prior map",
    "resolution_m": "side of a cell, m",
    "iou_fuse": "least IoU of fused boxes",
    "iou_ally": "least IoU with an ally's square",
    "message_delay_s": "delay of messages, s",
    "message_loss": "share of messages lost",
    "lidar_dropout": "share of beams without return",
    "intruder_speed_mps": "intruders' top speed, m/s",
}
UNITS = {  # end of a name -> its unit
    "_mps2": "m/s²",
    "_radps": "rad/s",
    "_percent": "%",
    "_mps": "m/s",
    "_deg": "degrees",
    "_rad": "rad",
    "_hz": "Hz",
    "_m": "m",
    "_s": "s",
}


class Style(NamedTuple):
    """Colour, marker and dash each tell the series apart alone: for colour-blind readers and grey print."""

    color: str
    marker: str
    dash: str | tuple[int, tuple[float, ...]]


STYLES = (  # Okabe and Ito's colours
    Style("#0072B2", "o", "-"),
    Style("#D55E00", "s", "--"),
    Style("#009E73", "^", "-."),
    Style("#CC79A7", "D", ":"),
    Style("#000000", "v", (0, (5, 1, 1, 1, 1, 1))),
)


@contextlib.contextmanager
def own_style() -> Iterator[None]:
    """Matplotlib draws by its defaults, whatever a ``matplotlibrc`` says; also a decorator."""
    with rc_context({key: value for key, value in rcParamsDefault.items() if not key.startswith("backend")}):
        yield


def chart(width_in: float, height_in: float, w_pad: float = 0.12, h_pad: float = 0.08) -> Figure:
    """An empty figure on a canvas of its own, laid out by its contents."""
    figure = Figure(figsize=(width_in, height_in), layout=ConstrainedLayoutEngine(w_pad=w_pad, h_pad=h_pad))
    FigureCanvasAgg(figure)
    return figure


def add_estimates(
    axes: Axes, places: Sequence[float], estimates: Sequence[Estimate], style: Style, label: str | None
) -> None:
    """A line through estimates at places along x, each with its interval as a bar."""
    values, lows, highs = (np.array([e[part] for e in estimates]) for part in range(3))
    # where all trials are alike the value may lie outside its interval, by a rounding
    bars = np.maximum(0.0, [values - lows, highs - values])
    look: dict[str, Any] = {"marker": style.marker, "linestyle": style.dash, "color": style.color}
    sizes: dict[str, Any] = {"markersize": 5, "linewidth": 1.3, "elinewidth": 0.8, "capsize": 2}
    axes.errorbar(places, values, bars, label=label, **look, **sizes)


class Panel(NamedTuple):
    """A panel of :func:`panel_figure`."""

    y: str  # label of its axis
    series: Mapping[str, Mapping[Any, Estimate]]
    """label -> place along x, a number or a text -> what is drawn there"""
    title: str = ""
    limits: tuple[float | None, float | None] = (None, None)  # of the y axis; None where the data decide
    trials: Mapping[str, Mapping[Any, Sequence[float]]] = {}
    """label -> place along x -> single values, a dot each"""
    levels: Sequence[tuple[float, str]] = ()  # (value, colour) of lines across the panel


@own_style()
def panel_figure(
    panels: Sequence[Panel],
    x: str,
    title: str,
    method: str,
    columns: int = 2,
    styles: Mapping[str, Style] = MappingProxyType({}),
    note: str = "",
) -> Figure:
    """Panels of estimates with their intervals: a line for each series over numbers, points over texts.

    ``panels`` stand row by row, in so many ``columns`` at most; ``x`` is the label of the axis that they have
    in common. The ``method`` of the intervals and the ``note`` stand at the foot. ``styles``: label -> an own
    style; the others have ``STYLES`` in turn.
    """
    places = list(dict.fromkeys(x for panel in panels for points in panel.series.values() for x in points))
    is_text = any(isinstance(place, str) for place in places)
    if not is_text:
        places.sort()
    at = {place: float(k if is_text else place) for k, place in enumerate(places)}
    gap = 1.0 if is_text else min([1.0, *np.diff(places)])
    columns = max(1, min(columns, len(panels)))
    rows = ceil(len(panels) / columns)
    width_in = max(3.6, 0.24 * len(places)) if is_text else 3.6
    figure = chart(width_in * columns + 1.2, (2.2 if is_text else 2.9) * rows + 0.6 + is_text)
    handles: dict[str, Artist] = {}
    for number, panel in enumerate(panels):
        axes = figure.add_subplot(rows, columns, number + 1)
        own = iter(cycle(STYLES))
        for place, (label, points) in enumerate(panel.series.items()):
            style = styles[label] if label in styles else next(own)
            shift = DODGE * gap * (place - (len(panel.series) - 1) / 2)
            shown = style._replace(dash="none") if is_text else style
            here = sorted(points, key=at.__getitem__)
            add_estimates(
                axes, [at[one] + shift for one in here], [points[one] for one in here], shown, label
            )
            trials = panel.trials.get(label, {}).items()
            if dots := [(at[one] + shift, value) for one, values in trials for value in values]:
                xs, ys = zip(*dots, strict=True)
                axes.scatter(xs, ys, s=7, color=style.color, alpha=0.45, lw=0, zorder=1.5)
        for level, color in panel.levels:
            axes.axhline(level, color=color, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
        axes.set(xlabel="" if is_text else x, ylabel=panel.y)
        axes.set_ylim(*panel.limits)
        axes.set_title(panel.title, fontsize=FONT_PT + 1)
        if is_text:
            is_last = number + columns >= len(panels)
            axes.set_xticks(range(len(places)), places if is_last else [""] * len(places), rotation=90)
        else:
            axes.xaxis.set_major_locator(MaxNLocator(integer=all(one == int(one) for one in places)))
            if len(places) == 1:
                axes.set_xlim(places[0] - 1.0, places[0] + 1.0)
        light_grid(axes)
        handles |= dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    if len(handles) > 1:
        figure.legend(handles.values(), handles, fontsize=FONT_PT, frameon=False, loc="outside right upper")
    each = [e for panel in panels for points in panel.series.values() for e in points.values()]
    hint = "dot: a trial" if any(panel.trials for panel in panels) else ""
    foot = "; ".join(filter(None, (counted(each, method), hint, note)))
    figure.suptitle(title, fontsize=FONT_PT + 2, x=0.01, ha="left")
    figure.supxlabel(foot, fontsize=FONT_PT - 2, color="#555555")
    return figure


def scores_figure(
    x: str,
    means: Mapping[str, Mapping[str, Mapping[Any, Estimate]]],
    trials: Mapping[str, Mapping[str, Mapping[float, Mapping[int, float]]]] = MappingProxyType({}),
    ranges: Mapping[str, tuple[float, float]] = MappingProxyType({}),
    baseline: str | None = None,
) -> Figure:
    """A panel for each score, with a line for each curve over a numeric factor, or points over its values.

    Args:
        x: label of the factor.
        means: score -> curve -> place along x -> the mean over seeds and its interval, the bar.
        trials: score -> curve -> place along x -> seed -> value; each is a dot.
        ranges: score -> the least and the greatest value that it can have; one in 0 to 1 has that axis.
        baseline: the value whose means go across the panels, which then stand below each other.
    """
    panels = []
    for score, curves in means.items():
        least, most = ranges.get(score, (None, None))
        limits = (0.0 if least == 0.0 else None, 1.03 if (least, most) == (0.0, 1.0) else None)
        dots = {
            label: {place: [*seeds.values()] for place, seeds in points.items()}
            for label, points in trials.get(score, {}).items()
        }
        levels = [
            (points[baseline].value, style.color)
            for points, style in zip(curves.values(), STYLES, strict=False)
            if baseline in points
        ]
        panels.append(Panel(axis_label(score), curves, limits=limits, trials=dots, levels=levels))
    note, columns = f"lines: {baseline}", 1
    if baseline is None:
        note, columns = "", 3 if len(means) > 4 else 2
    return panel_figure(panels, x, f"Scores by {x}", MEAN_METHOD, columns, note=note)


def axis_label(name: str, explanation: str = "") -> str:
    """What an axis says of a column or a parameter, such as ``message_delay_s``.

    The first clause of its help, ``explanation``, stands for a name that is not known here if it is short.
    """
    if name in AXIS_LABELS:
        return AXIS_LABELS[name]
    end = next((one for one in UNITS if name.endswith(one)), "")
    clause = explanation.split(".")[0].split(",")[0].split(";")[0].split(":")[0].split("(")[0].strip()
    words = name.removesuffix(end).replace("_", " ")
    if 0 < len(clause) <= LONGEST:
        is_word = clause.split()[0][1:].islower()  # and no abbreviation
        words = clause[0].lower() + clause[1:] if is_word else clause
    return f"{words}, {UNITS[end]}" if end else words


def light_grid(axes: Axes) -> None:
    """Faint horizontal lines behind the data, and no frame at the top and the right."""
    axes.grid(axis="y", color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def drawn_data(name: str, figure: Figure) -> Table:
    """What a figure shows, as a table: a row for each point of each line, with its interval if it has one.

    ``at`` is the label of the nearest tick where points are set apart along x, else the place itself.
    """
    rows: list[Mapping[str, Cell]] = []
    for axes in figure.axes:
        panel = ", ".join(filter(None, (axes.get_title() or axes.get_title("left"), axes.get_ylabel())))
        bars = [one for one in axes.containers if isinstance(one, ErrorbarContainer)]
        drawn = [(one.lines[0], str(one.get_label()), one.lines[2]) for one in bars]
        labels = {line: str(line.get_label()) for line in axes.lines}
        drawn += [(line, text, ()) for line, text in labels.items() if not text.startswith("_") and not bars]
        ticks = dict(zip(axes.get_xticks(), (one.get_text() for one in axes.get_xticklabels()), strict=False))
        for line, label, intervals in drawn:
            ends = [np.asarray(segment) for one in intervals for segment in one.get_segments()]
            for number, (x, y) in enumerate(np.asarray(line.get_xydata()).tolist()):
                tick = min(ticks, key=lambda place: abs(place - x)) if bars and ticks else None
                row: dict[str, Cell] = {
                    "panel": panel,
                    "series": "" if label.startswith("_") else label,
                    "at": f"{x:g}" if tick is None else ticks[tick].replace("\n", " ") or f"{tick:g}",
                    "value": y,
                }
                # a point without an interval has an empty bar
                if number < len(ends) and ends[number].ndim == 2:
                    low, high = ends[number][:, 1].min(), ends[number][:, 1].max()
                    row |= {"low": float(low), "high": float(high)}
                rows.append(row)
    return Table(f"{name}_data", f"Data of {name}", rows)


def counted(estimates: Sequence[Estimate], method: str) -> str:
    """``mean of 20 trials; 95 % intervals: ...``: what the points of a figure are made of."""
    counts = sorted({estimate.n for estimate in estimates if estimate.n}) or [0]
    each = f"mean of {' to '.join(map(str, sorted({counts[0], counts[-1]})))} trials"
    each = "one trial each" if counts == [1] else each
    has_interval = any(isfinite(estimate.low) for estimate in estimates)
    return f"{each}; {method}" if has_interval else f"{each}, without intervals"


@own_style()
def chart_files(figure: Figure, formats: Sequence[str] = FORMATS) -> dict[str, bytes]:
    """The figure's files by ending; the same figure gives the same bytes.

    Raises:
        InputError: one of ``formats`` is none of ``METADATA``.
    """
    if unknown := [one for one in formats if one not in METADATA]:
        raise InputError(f"figure format '{unknown[0]}': use {', '.join(METADATA)}")
    files = {}
    # laid out once for all formats, which takes as long as to draw
    figure.set_dpi(DPI)
    figure.draw_without_rendering()
    figure.set_layout_engine(None)
    # without a salt the ids in an SVG are random; type 42 keeps a PDF's text selectable
    with rc_context({"svg.hashsalt": "midnet-bench", "pdf.fonttype": 42}):
        for name in formats:
            buffer = io.BytesIO()
            figure.savefig(buffer, format=name, dpi=DPI, metadata=METADATA[name])
            files[f".{name}"] = buffer.getvalue()
    return files


@own_style()
def times_figure(
    teams: Mapping[str, tuple[Sequence[float], Estimate]], within_s: float, probability: float, done: str
) -> Figure:
    """The share of trials in which the intruder was found by each time, a step line for each team.

    ``teams``: label -> a time for each trial, NaN if it was not found, and the share with its interval, the
    bar at the end. The time ends at ``within_s``. ``probability`` is a grey line; ``done`` is ``found`` or
    ``caught``.
    """
    figure = chart(6.4, 3.6)
    axes = figure.add_subplot()
    for number, ((label, (times, final)), style) in enumerate(zip(teams.items(), cycle(STYLES))):
        at = np.sort([time for time in times if not np.isnan(time)])
        shares = np.arange(len(at) + 1) / len(times)
        x, y = [0.0, *at.tolist(), within_s], [*shares.tolist(), shares[-1]]
        axes.step(x, y, where="post", color=style.color, linestyle=style.dash, linewidth=1.4)
        # bars stand side by side behind the end
        place = within_s * (1.0 + ENDS * (number + 1))
        add_estimates(axes, [place], [final], style, label)
    axes.axhline(probability, color="#999999", linewidth=0.8)
    axes.set_xticks([tick for tick in axes.get_xticks() if 0.0 <= tick <= within_s])
    last = within_s * (1.0 + ENDS * (len(teams) + 1))
    axes.set(xlim=(0.0, last), ylim=(0.0, 1.02), xlabel="time since the intruder entered, s")
    axes.set_ylabel(f"intruders {done}, share of trials")
    light_grid(axes)
    figure.legend(
        fontsize=FONT_PT - 1, frameon=False, loc="outside right upper", title=f"probability {probability:g}"
    )
    figure.supxlabel(
        counted([final for _, final in teams.values()], SHARE_METHOD), fontsize=FONT_PT - 2, color="#555555"
    )
    return figure


@own_style()
def entrances_figure(
    walls: Sequence[Floats], places: pd.DataFrame, robots: int, within_s: float, done: str
) -> Figure:
    """The building with a dot for each start of an intruder, coloured by how long the guards took.

    ``walls``: outlines, (n, 2) each, metres; ``places``: ``x_m``, ``y_m``, ``share``, ``median_s`` of each;
    those where most are not found within ``within_s`` are red crosses. ``done``: ``found`` or ``caught``.
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
