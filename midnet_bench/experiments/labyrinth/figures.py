"""The labyrinth's figures: the paper's last one, with intervals, and how its points came about."""

from collections.abc import Mapping
from math import ceil
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import SHARE_METHOD, Estimate
from midnet_bench.drawing.charts import FONT_PT, add_series, chart, labelled
from midnet_bench.drawing.plots import own_style
from midnet_bench.experiments.labyrinth.trials import GUARD, INTRUDER, Variant, variants_of
from midnet_bench.io.files import plain_name

DODGE = 0.07
"""between neighbouring series, in security robots"""

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
    panels = {
        f"{campaign}: {name}" if name else campaign: success_panel(variant)
        for campaign, results in campaigns.items()
        for name, variant in variants_of(results).items()
    }
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
        "time to capture (s)": lambda k, q: variant.pooled_time(k, q, "capture_times"),
        "detected but not caught (%)": variant.not_caught,
    }
    by_role = {
        "driven (m per minute)": "metres_per_minute",
        "time stuck (%)": "stuck_percent",
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
    """Mean success rate over team size, a line per number of intruders; a panel per variant."""
    columns = min(2, len(panels))
    rows = ceil(len(panels) / columns)
    figure = chart(6.0 * columns, 4.0 * rows)
    for place, (name, panel) in enumerate(panels.items(), 1):
        axes = figure.add_subplot(rows, columns, place)
        add_series(axes, panel.rates, DODGE, "security robots")
        axes.set_ylim(-3, 103)
        axes.set_ylabel("success rate (%)")
        axes.set_title(name, fontsize=FONT_PT + 1)
        per_point = "-".join(map(str, panel.trials))
        _note(axes, f"{per_point} trials per point, {SHARE_METHOD}")
    figure.legend(*labelled(figure.axes[0]), fontsize=FONT_PT, frameon=False, loc="outside right upper")
    return figure


@own_style()
def details_figure(by_intruders: Mapping[str, Series], by_role: Mapping[str, Series]) -> Figure:
    """Two panels with a line per number of intruders, three with a line per role, over team size."""
    figure = chart(10.0, 6.0)
    panels = [figure.add_subplot(2, 3, place) for place in range(1, 6)]
    for axes, (label, series) in zip(panels, [*by_intruders.items(), *by_role.items()], strict=True):
        add_series(axes, series, DODGE, "security robots")
        axes.set_ylabel(label)
        top = 1.08 * axes.dataLim.y1 if axes.dataLim.y1 > 0.0 else 1.0
        axes.set_ylim(-0.03 * top, top)
    legend = figure.add_subplot(2, 3, 6)
    legend.set_axis_off()
    upper = legend.legend(*labelled(panels[0]), fontsize=FONT_PT, frameon=False, loc="upper left")
    legend.add_artist(upper)
    legend.legend(*labelled(panels[2]), fontsize=FONT_PT, frameon=False, loc="lower left")
    return figure


def _intruders(count: int) -> str:
    return f"{count} intruder{'s' if count > 1 else ''}"


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
