"""The experiments' figures, made of the numbers of their tables."""

import math
from collections.abc import Callable, Mapping

from matplotlib.figure import Figure

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import MEAN_METHOD, SHARE_METHOD, Estimate
from midnet_bench.drawing.charts import STYLES, Panel, Style, axis_label, panel_figure
from midnet_bench.experiments.detection.tables import SCORES, SHOWN, Team, cells_of, paper_of
from midnet_bench.experiments.labyrinth.tables import (
    GUARD,
    INTRUDER,
    Variant,
    counted,
    pooled_time,
    variants_of,
    variants_side_by_side,
)
from midnet_bench.experiments.mapping.tables import ENOUGH_COVERAGE, mean_of, teams_of
from midnet_bench.io.files import plain_name

MOST_CELLS = 60  # that a figure shows one beside the other
PAPER_STYLE = Style("#000000", "x", "")
ROLES = {"guards": GUARD, "intruders": INTRUDER}
ROLE_STYLES = {"guards": Style("#555555", "P", "-"), "intruders": Style("#E69F00", "X", "--")}
"""other colours and markers than those of numbers of intruders"""
HEALTH = {  # label of an axis -> column of ``Variant.robots``
    "driven, m per minute": "metres_per_minute",
    "time stuck, %": "stuck_percent",
    "goals given up per robot": "goals_given_up",
}
PANELS = {  # label of an axis -> label of a line -> column of ``maps``
    "time until no frontier is left, s": {"": "time_s"},
    "free space covered, share": {"": "coverage"},
    "occupied cells, within one cell": {"precision": "occupied_precision", "recall": "occupied_recall"},
}


def detection_figures(results: Results) -> dict[str, Figure]:
    """``scores_by_team``: a panel for each score; nothing before a trial has finished.

    A line through team sizes for each series; beyond five series, a point for each cell.
    """
    cells = cells_of(results)
    if not cells:
        return {}
    is_lines = len({team.others for team in cells}) <= len(STYLES)
    known = paper_of(results.definition)
    papers = {team: known[Team(team.robots)] for team in cells if Team(team.robots) in known}
    panels = []
    for score in SHOWN:
        series: dict[str, dict[int | str, Estimate]] = {}
        for team, cell in [*cells.items()][: None if is_lines else MOST_CELLS]:
            label, place = (team.others or "ours", team.robots) if is_lines else ("ours", _cell_name(team))
            series.setdefault(label, {})[place] = cell.means[score]
        for team, printed in papers.items() if score in SCORES else ():
            place = team.robots if is_lines else _cell_name(team)
            series.setdefault("paper", {})[place] = Estimate(printed[score], math.nan, math.nan, 0)
        panels.append(Panel(axis_label(score), series, limits=(0.0, 1.03)))
    title = f"Detection by {'size of the team' if is_lines else 'cell'}"
    styles = {"paper": PAPER_STYLE}
    figure = panel_figure(panels, axis_label("robots"), title, MEAN_METHOD, 2 if is_lines else 1, styles)
    return {"scores_by_team": figure}


def _cell_name(team: Team) -> str:
    return f"{team.robots} robot{'s' * (team.robots > 1)}{', ' * bool(team.others)}{team.others}"


def labyrinth_figures(results: Results) -> dict[str, Figure]:
    """``success_rate``, and ``labyrinth_details`` for each variant of the grid."""
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


def mapping_figures(results: Results) -> dict[str, Figure]:
    """``mapping``: each trial as a dot, each team's mean with its 95 % interval over seeds."""
    maps, panels = teams_of(results, "maps"), []
    for arena in dict.fromkeys(arena for arena, _ in maps):
        teams = {size: trials for (place, size), trials in maps.items() if place == arena}
        for label, lines in PANELS.items():
            is_coverage, is_time = ("coverage" in lines.values(), "time_s" in lines.values())
            panels.append(
                Panel(
                    label,
                    {name: {q: mean_of(teams[q], column) for q in teams} for name, column in lines.items()},
                    arena,
                    (0.0 if is_time else None, 1.002 if is_coverage else None),
                    {name: {q: teams[q][column].tolist() for q in teams} for name, column in lines.items()},
                    [(ENOUGH_COVERAGE, "#888888")] if is_coverage else (),
                )
            )
    title = "Maps by size of the team"
    return {"mapping": panel_figure(panels, "robots that explore", title, MEAN_METHOD, 3)} if panels else {}
