"""The labyrinth's figures: the paper's last one, with intervals, and how its points came about."""

from collections.abc import Callable, Mapping

from matplotlib.figure import Figure

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import MEAN_METHOD, SHARE_METHOD, Estimate
from midnet_bench.drawing.charts import Panel, Style, axis_label, panel_figure
from midnet_bench.experiments.labyrinth.trials import (
    GUARD,
    INTRUDER,
    Variant,
    counted,
    pooled_time,
    variants_of,
    variants_side_by_side,
)
from midnet_bench.io.files import plain_name

ROLES = {"guards": GUARD, "intruders": INTRUDER}
ROLE_STYLES = {"guards": Style("#555555", "P", "-"), "intruders": Style("#E69F00", "X", "--")}
"""other colours and markers than those of numbers of intruders"""
HEALTH = {  # label of an axis -> column of ``Variant.robots``
    "driven, m per minute": "metres_per_minute",
    "time stuck, %": "stuck_percent",
    "goals given up per robot": "goals_given_up",
}


def figures(results: Results) -> dict[str, Figure]:
    """The figures of a labyrinth campaign: ``success_rate``, and ``labyrinth_details`` for each variant."""
    variants = variants_of(results)
    if not variants:
        return {}
    drawn = {"success_rate": success_figure(variants)}
    for name, one in variants.items():
        suffix = f"_{name.replace('=', '-').replace(', ', '_')}" if name else ""
        drawn[plain_name(f"labyrinth_details{suffix}")] = details_figure(one)
    return drawn


def comparison_figures(campaigns: Mapping[str, Results]) -> dict[str, Figure]:
    """Several campaigns' success rates, a line for each."""
    variants = variants_side_by_side(campaigns)
    return {"success_comparison": success_figure(variants)} if variants else {}


def success_figure(variants: Mapping[str, Variant]) -> Figure:
    """Mean success rate over team size: a panel per number of intruders, a line per variant in each."""
    panels = []
    for count in sorted({count for one in variants.values() for count in one.intruder_counts}):
        lines = {
            name: {robots: one.success(count, robots) for robots in one.team_sizes}
            for name, one in variants.items()
            if count in one.intruder_counts
        }
        panels.append(Panel(axis_label("success_rate"), lines, counted(count, "intruder"), (-3.0, 103.0)))
    title = "Intruders caught by size of the team"
    return panel_figure(panels, axis_label("robots"), title, SHARE_METHOD, 3)


def details_figure(one: Variant) -> Figure:
    """Panels with a line per number of intruders, and with a line per role, over team size.

    What is 0 in every cell has no panel; the figure says so.
    """
    cells = {(intruders, robots): cell for intruders, robots, cell in one.cells()}
    nothing = one.trials[:0]
    by_intruders: dict[str, Callable[[int, int], Estimate]] = {
        "time to capture, s": lambda k, q: pooled_time(cells.get((k, q), nothing), "capture_times"),
        "detected but not caught, %": lambda k, q: one.percent("detected_not_caught", k, q),
    }
    panels = [
        Panel(
            label,
            {
                counted(k, "intruder"): {q: estimate(k, q) for q in one.team_sizes}
                for k in one.intruder_counts
            },
        )
        for label, estimate in by_intruders.items()
    ]
    for label, column in HEALTH.items():
        lines = {
            name: {q: one.health(role, q, column) for q in one.team_sizes} for name, role in ROLES.items()
        }
        panels.append(Panel(label, lines))
    shown = [panel for panel in panels if not _is_zero(panel)] or panels[:1]
    zeros = [panel.y for panel in panels if panel not in shown]
    note = f"0 in every cell: {', '.join(zeros)}" if zeros else ""
    return panel_figure(
        shown, axis_label("robots"), "Behind the success rate", MEAN_METHOD, 3, ROLE_STYLES, note
    )


def _is_zero(panel: Panel) -> bool:
    """Whether nothing of it differs from 0, where it is known."""
    values = [estimate.value for points in panel.series.values() for estimate in points.values()]
    return all(value == 0.0 or value != value for value in values)
