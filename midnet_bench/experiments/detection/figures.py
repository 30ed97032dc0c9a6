"""The detection test's figure: precision, recall and F1 by team size, ours and the paper's."""

import math
from collections.abc import Mapping, Sequence
from itertools import cycle

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from midnet_bench.analysis.frames import Results
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
from midnet_bench.experiments.detection.counting import PAPER, SCORES, Team, paper_of
from midnet_bench.experiments.detection.tables import cells_of, score_over_seeds

SHOWN = (*SCORES, "f1_one_to_one")
DODGE = 0.09
"""between neighbouring series, in robots"""
MOST_CELLS = 60
"""that a figure shows one beside the other"""
PAPER_STYLE = Style("#000000", "x", "")
Points = Mapping[str, Mapping[str, Sequence[tuple[int, Estimate]]]]
"""what else is varied -> score -> (team size, mean over seeds with its interval)"""


def figures(results: Results) -> dict[str, Figure]:
    """``scores_by_team``: a panel for each score; nothing before a trial has finished."""
    points = points_of(results)
    if not points:
        return {}
    return {"scores_by_team": team_figure(points, bool(paper_of(results.definition)))}


def points_of(results: Results) -> Points:
    """The scores of each cell by what else is varied and by team size."""
    found: dict[str, dict[str, list[tuple[int, Estimate]]]] = {}
    for name, cell in cells_of(results).items():
        for score in SHOWN:
            at = (name.robots, score_over_seeds(cell, score))
            found.setdefault(name.others, {}).setdefault(score, []).append(at)
    return found


@own_style()
def team_figure(points: Points, has_paper: bool) -> Figure:
    """A line through team sizes for each series; beyond five series, a point for each cell.

    Args:
        points: the scores.
        has_paper: whether the paper's scores are of this arena.
    """
    is_lines = len(points) <= len(STYLES)
    estimates = [e for scores in points.values() for each in scores.values() for _, e in each]
    if is_lines:
        figure = chart(6.8, 5.4)
    else:
        cells = min(MOST_CELLS, sum(len(scores[SHOWN[0]]) for scores in points.values()))
        figure = chart(max(6.0, 1.6 + 0.24 * cells), 2.0 * len(SHOWN) + 1.5)
    shape = (2, 2) if is_lines else (len(SHOWN), 1)
    panels = figure.subplots(*shape, sharex=True, sharey=True, squeeze=False).flat
    for axes, score in zip(panels, SHOWN, strict=True):
        (_add_lines if is_lines else _add_cells)(axes, points, score)
        if has_paper and score in SCORES:
            _add_paper(axes, points, score, is_lines)
        axes.set_ylim(0.0, 1.03)
        axes.set_ylabel(axis_label(score), fontsize=FONT_PT)
        axes.tick_params(labelsize=FONT_PT - 1, labelleft=True)
        light_grid(axes)
    handles, labels = labelled(figure.axes[0])
    if len(labels) > 1:
        figure.legend(handles, labels, fontsize=FONT_PT, frameon=False, loc="outside right upper")
    figure.suptitle(
        f"Detection by {'size of the team' if is_lines else 'cell'}", fontsize=FONT_PT + 2, x=0.01, ha="left"
    )
    figure.supxlabel(counted(estimates, MEAN_METHOD), fontsize=FONT_PT - 2, color="#555555")
    return figure


def _add_lines(axes: Axes, points: Points, score: str) -> None:
    teams = sorted({team for scores in points.values() for team, _ in scores[score]})
    for index, ((label, scores), style) in enumerate(zip(points.items(), cycle(STYLES))):
        shift = DODGE * (index - (len(points) - 1) / 2)
        by_team = sorted(scores[score])
        name = label or "ours"
        add_estimates(axes, [team + shift for team, _ in by_team], [e for _, e in by_team], style, name)
    axes.set_xticks(teams, [str(team) for team in teams])
    axes.set_xlim(teams[0] - 0.6, teams[-1] + 0.6)
    axes.set_xlabel(axis_label("robots"), fontsize=FONT_PT)


def _add_cells(axes: Axes, points: Points, score: str) -> None:
    cells = _cells(points, score)
    add_estimates(axes, range(len(cells)), [e for _, _, e in cells], STYLES[0]._replace(dash=""), "ours")
    names = [f"{team} robot{'s' * (team > 1)}{', ' * bool(label)}{label}" for label, team, _ in cells]
    axes.set_xticks(range(len(cells)), names, rotation=90)


def _cells(points: Points, score: str) -> list[tuple[str, int, Estimate]]:
    each = ((label, team, e) for label, scores in points.items() for team, e in scores[score])
    return list(each)[:MOST_CELLS]


def _add_paper(axes: Axes, points: Points, score: str, is_lines: bool) -> None:
    teams = [team for _, team, _ in _cells(points, score)]
    at = sorted(set(teams)) if is_lines else range(len(teams))
    known = [
        (x, Estimate(float(str(PAPER[name][score])), math.nan, math.nan, 1))
        for x, team in zip(at, sorted(set(teams)) if is_lines else teams, strict=True)
        if (name := Team(team)) in PAPER
    ]
    if known:
        add_estimates(axes, [x for x, _ in known], [e for _, e in known], PAPER_STYLE, "paper")
