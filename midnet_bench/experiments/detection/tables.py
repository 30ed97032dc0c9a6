"""The paper's detection table from a campaign's store: ours, the paper's, and how sure ours is."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from midnet_bench.analysis import statistics
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.store import Store, StoredTrial
from midnet_bench.campaign.trial import Row
from midnet_bench.rng import stream
from midnet_bench.scoring.ratios import ratios

PAPER: Mapping[str, Row] = {
    "1-robot": {"tp": 6967, "fp": 176, "fn": 1889, "precision": 0.975, "recall": 0.787, "f1": 0.871},
    "5-robot": {"tp": 14953, "fp": 1047, "fn": 619, "precision": 0.935, "recall": 0.960, "f1": 0.947},
}
"""The paper's only table."""
PAPER_FRAMES = 1999

SCORES = ("precision", "recall", "f1")

Cells = Mapping[str, Sequence[Row]]
"""The ``scores`` rows of each cell's trials, with their seeds, by the cell's name in the paper's manner."""


def cells_of(store: Store) -> Cells:
    """The finished trials of each cell, seeds ascending; cells in the campaign's order."""
    cells: dict[str, list[Row]] = {}
    for trial in store.trials():
        if trial.status == "finished":
            cells.setdefault(_name(store, trial), []).append(
                {"seed": trial.seed, **trial.tables["scores"][0]}
            )
    return cells


def scores_table(cells: Cells) -> Table:
    """A row per cell: counts summed over its seeds, ratios of the sums (Eqs. 8 to 10)."""
    rows: list[Row] = []
    for name, trials in cells.items():
        tp, fp, fn = (_sum(trials, key) for key in ("tp", "fp", "fn"))
        counts: Row = {"frames": _sum(trials, "frames"), "tp": tp, "fp": fp, "fn": fn}
        rows.append({"trial": name, **counts, **ratios(tp, fp, fn)._asdict()})
    return Table("Detection scores", rows)


def matching_table(cells: Cells) -> Table:
    """The same frames by one-to-one matching: an intruder is found once, further boxes are false."""
    rows: list[Row] = []
    for name, trials in cells.items():
        matched, duplicates, missed = (_sum(trials, key) for key in ("matched", "duplicates", "missed"))
        scored = ratios(matched, _sum(trials, "fp") + duplicates, missed)
        error_m = (
            sum(float(row["error_sum_m"] or 0.0) for row in trials) / matched if matched else float("nan")
        )
        counts: Row = {"matched": matched, "duplicates": duplicates, "missed": missed}
        rows.append({"trial": name, **counts, **scored._asdict(), "mean_error_m": error_m})
    return Table("One-to-one matching", rows)


def by_seed_table(cells: Cells) -> Table:
    """A row per cell and seed."""
    return Table(
        "Scores by seed", [{"trial": name, **row} for name, trials in cells.items() for row in trials]
    )


def comparison_table(cells: Cells) -> Table:
    """Ours beside the paper's: means over seeds with 95 % bootstrap intervals, and the difference."""
    rows: list[Row] = []
    for name, trials in cells.items():
        for score in SCORES:
            ours = score_over_seeds(trials, score)
            paper = PAPER[name][score] if name in PAPER else float("nan")
            assert isinstance(paper, float)
            rows.append(
                {
                    "trial": name,
                    "score": score,
                    "ours": ours.value,
                    "low": ours.low,
                    "high": ours.high,
                    "paper": paper,
                    "difference": ours.value - paper,
                    "seeds": ours.n,
                }
            )
    return Table("Ours and the paper's", rows)


def side_by_side_table(cells: Cells) -> Table:
    """What a terminal shows: each of our rows above the paper's, intervals where there are several seeds."""
    rows: list[Row] = []
    for row, trials in zip(scores_table(cells).rows, cells.values(), strict=True):
        name = str(row["trial"])
        rows.append(row)
        if len(trials) > 1:
            estimates = {score: score_over_seeds(trials, score) for score in SCORES}
            means: Row = {
                score: f"{one.value:.3f} [{one.low:.3f}, {one.high:.3f}]" for score, one in estimates.items()
            }
            rows.append({"trial": f"  mean of {len(trials)} seeds", **means})
        if name in PAPER:
            rows.append({"trial": "  the paper", "frames": PAPER_FRAMES, **PAPER[name]})
    return Table("Detection scores, ours and the paper's", rows)


def score_over_seeds(trials: Sequence[Row], score: str) -> statistics.Estimate:
    """The mean of one score over a cell's trials and its interval; the bootstrap has a seed of its own."""
    values = [value if isinstance(value := row[score], float) else float("nan") for row in trials]
    return statistics.mean(values, stream(0, "bootstrap", score))


def write_detection_report(store: Store, directory: Path) -> list[Table]:
    """Write the tables of a detection campaign into ``directory``; those worth printing, in order."""
    cells = cells_of(store)
    scores, matching, comparison = scores_table(cells), matching_table(cells), comparison_table(cells)
    scores.write(directory / "detection_scores")
    matching.write(directory / "detection_matching")
    comparison.write(directory / "detection_comparison")
    by_seed_table(cells).write(directory / "scores_by_seed")
    return [side_by_side_table(cells), matching]


def _name(store: Store, trial: StoredTrial) -> str:
    cell = store.definition.cell_of(trial.parameters)
    others = [f"{key}={value}" for key, value in cell.items() if key != "robots"]
    return ", ".join([f"{trial.parameters['robots']}-robot", *others])


def _sum(trials: Sequence[Row], key: str) -> int:
    return sum(int(row[key] or 0) for row in trials)
