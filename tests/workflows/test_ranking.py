"""Rankings, from stores made by hand."""

from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import mean
from midnet_bench.campaign.definition import Definition
from midnet_bench.errors import InputError
from midnet_bench.experiments.registry import experiment_of
from midnet_bench.workflows import ranking as module
from midnet_bench.workflows.ranking import rank, write_ranking

SEEDS = range(1, 7)


def results(hits: dict[tuple[str, str], int]) -> Results:
    """A detection campaign in which each detector and fusion hits about so many of 100."""
    scores = [
        {
            "detector": detector,
            "fusion": fusion,
            "seed": seed,
            "frames": 10,
            **{"tp": hit, "fp": 0, "fn": 100 - hit},
            **{"matched": hit, "duplicates": 0, "missed": 100 - hit},
            "gospa_m": float(100 - hit),
            **{"precision": 1.0, "recall": hit / 100, "f1": 0.5},
        }
        for (detector, fusion), mean in hits.items()
        for seed in SEEDS
        for hit in [mean + (seed * len(detector + fusion)) % 7 - 3]
    ]
    grid = {name: list(dict.fromkeys(row[name] for row in scores)) for name in ("detector", "fusion")}
    definition = Definition("detection", 1, len(SEEDS), grid, {"robots": 5})
    frames = {"scores": pd.DataFrame(scores), "robots": pd.DataFrame()}
    return Results(Path("somewhere"), definition, [], frames, pd.DataFrame(), pd.DataFrame())


@pytest.fixture
def compared(monkeypatch: pytest.MonkeyPatch) -> None:
    hits = {("midnet", "paper"): 60, ("midnet", "none"): 40, ("mine", "paper"): 80, ("mine", "none"): 60}
    monkeypatch.setattr(module, "load_results", lambda *_: results(hits))


@pytest.mark.usefixtures("compared")
def test_the_best_comes_first_and_differences_are_from_the_first_of_the_grid(tmp_path: Path) -> None:
    by_f1, by_gospa = rank("somewhere")
    assert [(row["rank"], row["detector"], row["fusion"], row["verdict"]) for row in by_f1.rows] == [
        (1, "mine", "paper", "better"),
        (2, "midnet", "paper", "the first"),
        (3, "mine", "none", "no clear difference"),
        (4, "midnet", "none", "worse"),
    ]
    # gospa falls with each hit, so the same order comes out of the lowest first
    assert [row["verdict"] for row in by_gospa.rows] == [row["verdict"] for row in by_f1.rows]
    best = by_gospa.rows[0]["difference"]
    assert best.value == pytest.approx(-2.0, abs=0.2)  # type: ignore[union-attr]
    write_ranking("somewhere", [by_f1, by_gospa], tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert text.startswith("# Leaderboard: somewhere\n")
    assert "seeds 1 to 6" in text
    assert text.count("\n## Ranked by ") == 2
    assert "| mine" in text


@pytest.mark.usefixtures("compared")
def test_one_factor_makes_the_other_a_world() -> None:
    (ranked,) = rank("somewhere", of=["detector"], rank_by="recall")
    assert [(row["world"], row["detector"]) for row in ranked.rows] == [
        ("5-robot, fusion=paper", "mine"),
        ("5-robot, fusion=paper", "midnet"),
        ("5-robot, fusion=none", "mine"),
        ("5-robot, fusion=none", "midnet"),
    ]


@pytest.mark.usefixtures("compared")
def test_what_cannot_be_ranked_is_said() -> None:
    with pytest.raises(InputError, match=r"no factor 'detectro'.*detector"):
        rank("somewhere", of=["detectro"])
    with pytest.raises(InputError, match="no score 'f2'"):
        rank("somewhere", rank_by="f2")


@pytest.mark.usefixtures("compared")
def test_all_cells_together_are_no_world_of_their_own_where_there_is_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    record = module.experiment_of(results({("midnet", "paper"): 60}))
    measured = record.report.measures
    assert measured is not None

    def twice(of: Results) -> pd.DataFrame:
        found = measured(of)
        return pd.concat([found, found.assign(robots=None, scope="all cells")])

    record = replace(record, report=replace(record.report, measures=twice))
    monkeypatch.setattr(module, "experiment_of", lambda of: record)
    by_f1, _ = rank("somewhere")
    assert len(by_f1.rows) == 4
    assert not any("world" in row for row in by_f1.rows)


@pytest.mark.usefixtures("compared")
def test_an_experiment_that_names_no_score_is_ranked_by_all(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    record = module.experiment_of(results({("midnet", "paper"): 60}))
    record = replace(record, report=replace(record.report, ranked_by=()))
    monkeypatch.setattr(module, "experiment_of", lambda of: record)
    tables = rank("somewhere", of=["detector"])
    assert {"leaderboard_recall", "leaderboard_precision"} <= {table.name for table in tables}
    write_ranking("somewhere", tables, tmp_path / "page.md")


def test_a_campaign_without_a_finished_trial_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    found = results({("midnet", "paper"): 60, ("mine", "paper"): 60})
    empty = {name: frame.iloc[:0] for name, frame in found.tables.items()}
    monkeypatch.setattr(module, "load_results", lambda *_: replace(found, tables=empty))
    with pytest.raises(InputError, match="somewhere: no trial has finished"):
        rank("somewhere")


def test_less_is_better_of_times_errors_and_what_went_wrong() -> None:
    record = experiment_of(results({("midnet", "paper"): 60}))
    wanted = ("gospa_per_frame_m", "first_detection_s", "motp_m", "id_switches", "never_detected")
    assert all(record.wants_less(name) for name in wanted)
    assert not any(record.wants_less(name) for name in ("f1", "mota", "idf1", "precision"))


def test_shares_and_their_differences_stay_where_shares_can_be(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found = results({("midnet", "paper"): 0, ("mine", "paper"): 97})
    rare = [0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    found.tables["scores"]["recall"] = [*rare, *[1.0] * 6]
    monkeypatch.setattr(module, "load_results", lambda *_: found)
    (ranked,) = rank("somewhere", rank_by="recall")
    write_ranking("somewhere", [ranked], tmp_path / "page.md")
    best, first = ranked.rows
    assert mean(rare).high > 1.0
    assert first["recall"][1:3] == (0.0, 1.0)  # type: ignore[index]
    assert (best["outlier_seed"], first["outlier_seed"]) == (6, None)
    assert best["difference"][1:3] == (pytest.approx(1.0 - mean(rare).high), 1.0)  # type: ignore[index]
    assert (tmp_path / "page.md").read_text(encoding="utf-8").count("outlier_seed: the difference") == 1
