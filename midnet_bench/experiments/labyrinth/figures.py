"""The labyrinth's figures: the paper's last one, with intervals, and how its points came about."""

from collections.abc import Mapping
from math import ceil
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import SHARE_METHOD, Estimate
from midnet_bench.drawing.charts import FONT_PT, STYLES, Style, add_series, chart, counted, labelled
from midnet_bench.drawing.labels import axis_label
from midnet_bench.drawing.plots import own_style
from midnet_bench.experiments.labyrinth.trials import (
    GUARD,
    INTRUDER,
    Variant,
    variants_of,
    variants_side_by_side,
)
from midnet_bench.io.files import plain_name

DODGE = 0.07
"""between neighbouring series, in security robots"""
MOST_COLUMNS = 3
ROLE_STYLES = (Style("#555555", "P", "-"), Style("#E69F00", "X", "--"))
"""of guards and intruders, other colours and markers than those of numbers of intruders"""

Series = Mapping[str, Mapping[int, Estimate]]
"""label -> team size -> what is drawn there"""


class Panel(NamedTuple):
    """A panel of the figure of success rates."""

    rates: Series
    trials: list[int]
    """how many trials stand behind the points: the fewest and the most"""


def figures(results: Results) -> dict[str, Figure]:
    """The figures of a labyrinth campaign: ``success_rate``, and ``labyrinth_details`` for each variant."""
    variants = variants_of(results)
    if not variants:
        return {}
    drawn = {"success_rate": success_figure({name: success_panel(one) for name, one in variants.items()})}
    for name, one in variants.items():
        suffix = f"_{name.replace('=', '-').replace(', ', '_')}" if name else ""
        drawn[plain_name(f"labyrinth_details{suffix}")] = details_figure(*details_series(one))
    return drawn


def comparison_figures(campaigns: Mapping[str, Results]) -> dict[str, Figure]:
    """Several campaigns' success rates, a panel for each."""
    panels = {name: success_panel(variant) for name, variant in variants_side_by_side(campaigns).items()}
    return {"success_comparison": success_figure(panels)} if panels else {}


def success_panel(variant: Variant) -> Panel:
    """The numbers of one panel."""
    counts = {len(cell) for _, _, cell in variant.cells()}
    rates = {
        _intruders(count): {robots: variant.success(count, robots) for robots in variant.team_sizes}
        for count in variant.intruder_counts
    }
    return Panel(rates, sorted({min(counts), max(counts)}))


def details_series(variant: Variant) -> tuple[dict[str, Series], dict[str, Series]]:
    """What lies behind the success rates, by label of its axis: by number of intruders, and by role."""
    by_intruders = {
        "time to capture, s": lambda k, q: variant.pooled_time(k, q, "capture_times"),
        "detected but not caught, %": variant.not_caught,
    }
    by_role = {
        "driven, m per minute": "metres_per_minute",
        "time stuck, %": "stuck_percent",
        "goals given up per robot": "goals_given_up",
    }
    return {
        label: {
            _intruders(k): {q: estimate(k, q) for q in variant.team_sizes} for k in variant.intruder_counts
        }
        for label, estimate in by_intruders.items()
    }, {
        label: {
            f"{role}s": {q: variant.health(role, q, column) for q in variant.team_sizes}
            for role in (GUARD, INTRUDER)
        }
        for label, column in by_role.items()
    }


@own_style()
def success_figure(panels: Mapping[str, Panel]) -> Figure:
    """Mean success rate over team size: a panel per number of intruders, a line per variant in each."""
    counts = sorted({label for panel in panels.values() for label in panel.rates}, key=_leading_number)
    columns = min(MOST_COLUMNS, len(counts))
    rows = ceil(len(counts) / columns)
    figure = chart(max(5.0, 2.7 * columns + 0.8), 2.7 * rows + 0.6)
    for number, count in enumerate(counts, 1):
        axes = figure.add_subplot(rows, columns, number)
        series = {name: panel.rates[count] for name, panel in panels.items() if count in panel.rates}
        add_series(axes, series, DODGE, axis_label("robots"))
        axes.set_ylim(-3, 103)
        axes.set_title(count, fontsize=FONT_PT + 1)
        if number % columns == 1 or columns == 1:
            axes.set_ylabel(axis_label("success_rate"))
    if any(panels):
        figure.legend(*labelled(figure.axes[0]), fontsize=FONT_PT, frameon=False, loc="outside right upper")
    each = [e for panel in panels.values() for rates in panel.rates.values() for e in rates.values()]
    figure.suptitle("Intruders caught by size of the team", fontsize=FONT_PT + 2, x=0.01, ha="left")
    figure.supxlabel(
        counted(each, SHARE_METHOD),
        fontsize=FONT_PT - 2,
        color="#555555",
    )
    return figure


@own_style()
def details_figure(by_intruders: Mapping[str, Series], by_role: Mapping[str, Series]) -> Figure:
    """Panels with a line per number of intruders, and with a line per role, over team size.

    What is 0 in every cell has no panel; the figure says so.
    """
    all_of = [(label, series, False) for label, series in by_intruders.items()]
    all_of += [(label, series, True) for label, series in by_role.items()]
    shown = [one for one in all_of if not _is_zero(one[1])] or all_of[:1]
    columns = 2 if len(shown) in (2, 4) else min(3, len(shown))
    figure = chart(3.6 * columns + 1.2, 3.0 * ceil(len(shown) / columns) + 0.4)
    legends: dict[bool, Axes] = {}
    for number, (label, series, is_role) in enumerate(shown, 1):
        axes = figure.add_subplot(ceil(len(shown) / columns), columns, number)
        # the two kinds of lines look different
        add_series(axes, series, DODGE, axis_label("robots"), ROLE_STYLES if is_role else STYLES)
        axes.set_ylabel(label)
        top = 1.08 * axes.dataLim.y1 if axes.dataLim.y1 > 0.0 else 1.0
        axes.set_ylim(-0.03 * top, top)
        legends.setdefault(is_role, axes)
    for is_role, axes in legends.items():
        figure.legend(
            *labelled(axes),
            fontsize=FONT_PT,
            frameon=False,
            loc="outside right lower" if is_role else "outside right upper",
        )
    figure.suptitle("Behind the success rate", fontsize=FONT_PT + 2, x=0.01, ha="left")
    if zeros := [label for label, series, _ in all_of if _is_zero(series) and len(shown) < len(all_of)]:
        figure.supxlabel(f"0 in every cell: {'; '.join(zeros)}", fontsize=FONT_PT - 2, color="#555555")
    return figure


def _is_zero(series: Series) -> bool:
    """Whether nothing of it differs from 0, where it is known."""
    values = [estimate.value for points in series.values() for estimate in points.values()]
    return all(value == 0.0 or value != value for value in values)


def _leading_number(label: str) -> int:
    return int(label.partition(" ")[0])


def _intruders(count: int) -> str:
    return f"{count} intruder{'s' if count > 1 else ''}"
