"""The detection test's figure: precision, recall and F1 by team size, ours and the paper's."""

import math

from matplotlib.figure import Figure

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate
from midnet_bench.drawing.charts import STYLES, Panel, Style, axis_label, panel_figure
from midnet_bench.experiments.detection.tables import SCORES, SHOWN, Team, cells_of, paper_of

MOST_CELLS = 60  # that a figure shows one beside the other
PAPER_STYLE = Style("#000000", "x", "")


def figures(results: Results) -> dict[str, Figure]:
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
            label, place = (team.others or "ours", team.robots) if is_lines else ("ours", _cell(team))
            series.setdefault(label, {})[place] = cell.means[score]
        for team, printed in papers.items() if score in SCORES else ():
            place = team.robots if is_lines else _cell(team)
            series.setdefault("paper", {})[place] = Estimate(printed[score], math.nan, math.nan, 0)
        panels.append(Panel(axis_label(score), series, limits=(0.0, 1.03)))
    title = f"Detection by {'size of the team' if is_lines else 'cell'}"
    styles = {"paper": PAPER_STYLE}
    figure = panel_figure(panels, axis_label("robots"), title, MEAN_METHOD, 2 if is_lines else 1, styles)
    return {"scores_by_team": figure}


def _cell(team: Team) -> str:
    return f"{team.robots} robot{'s' * (team.robots > 1)}{', ' * bool(team.others)}{team.others}"
