"""What each disturbance costs: scores, and their differences from undisturbed trials on the same seeds."""

from collections.abc import Mapping

from midnet_bench.analysis import statistics
from midnet_bench.analysis.differences import BySeed, differences
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.experiments.detection.counting import with_boxes
from midnet_bench.experiments.detection.tables import by_seed
from midnet_bench.experiments.guarded.metric_tables import metric_tables
from midnet_bench.experiments.robustness.parameters import NONE

MEASURES = ("recall", "precision", "f1_one_to_one")

Scores = Mapping[tuple[str, str, str], BySeed]
"""(team, disturbance, measure) -> its value at each seed"""


def tables(results: Results) -> list[Table]:
    """The tables of a campaign with disturbances."""
    scores = results.once(scores_of)
    return [scores_table(scores), differences_table(scores), *metric_tables(results)]


def scores_of(results: Results) -> Scores:
    """The scores of the finished trials: disturbances in the campaign's order, and in each the teams."""
    frame = results.table("scores")
    if frame.empty:
        return {}
    frame = with_boxes(results, frame).assign(
        disturbance=results.column(frame, "disturbance"),
        team=results.teams(frame, "disturbance"),
    )
    asked = results.definition.grid.get("disturbance", [results.definition.parameters.get("disturbance")])
    cells = {key: cell for key, cell in frame.groupby(["team", "disturbance"], sort=False)}
    teams = list(dict.fromkeys(frame["team"]))
    return {
        (team, str(name), measure): by_seed(cells[team, name], measure)
        for name in asked
        for team in teams
        if (team, name) in cells
        for measure in MEASURES
    }


def score(scores: Scores, team: str, disturbance: str, measure: str) -> statistics.Estimate:
    """The mean of one score over seeds, and its interval; without trials, undefined."""
    values = list(scores.get((team, disturbance, measure), {}).values())
    return statistics.mean(values, within=(0.0, 1.0))


def scores_table(scores: Scores) -> Table:
    """A row per disturbance and team: the three scores as means over seeds."""
    rows: list[Mapping[str, Cell]] = [
        {
            "disturbance": name,
            "trial": team,
            **{measure: score(scores, team, name, measure) for measure in MEASURES},
        }
        for team, name in dict.fromkeys((team, name) for team, name, _ in scores)
    ]
    title = f"Scores under each disturbance ({statistics.MEAN_METHOD}, over seeds)"
    return Table("robustness_scores", title, rows)


def differences_table(scores: Scores) -> Table:
    """A row per disturbance, team and score: its difference from undisturbed trials on the same seeds."""
    places = [
        (team, name, measure)
        for team, name, measure in scores
        if name != NONE
        and any(seed in scores.get((team, NONE, measure), {}) for seed in scores[team, name, measure])
    ]
    pairs = [(scores[team, NONE, measure], scores[team, name, measure]) for team, name, measure in places]
    changes = differences(pairs, [(0.0, 1.0)] * len(pairs))
    rows: list[Mapping[str, Cell]] = [
        {
            "disturbance": name,
            "trial": team,
            "score": measure,
            "undisturbed": one.before,
            "disturbed": one.after,
            "difference": one.change,
            "seeds": one.seeds,
            "outlier_seed": one.outlier_seed,
            "p_holm": one.p_holm,
            "verdict": one.verdict(),
        }
        for (team, name, measure), one in zip(places, changes, strict=True)
    ]
    how = f"{statistics.MEAN_METHOD}; verdicts by Holm at 5 %"
    title = f"Differences from undisturbed trials on the same seeds ({how})"
    notes = statistics.outlier_notes(one.outlier_seed for one in changes)
    bounds = {"difference": ("low", "high", "n")}
    others = ("seeds", "p_holm", "outlier_seed", "disturbed", "undisturbed")
    name = "robustness_differences"
    return Table(name, title, rows, {"p_holm": 4}, bounds=bounds, notes=notes, beside=others)
