"""``run standard``: a method in its place among the shipped ones."""

import json
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import pandas as pd
import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.campaign.definition import Definition, load_campaign, resolve
from midnet_bench.experiments import registry
from midnet_bench.experiments.registry import tables_of
from midnet_bench.workflows import standing
from tests.cli.command import Done, rows, worked
from tests.cli.test_cli_parts import MINE

SHORT = ("--seeds", 1, "--seed", 9101, "--frames", 2, "--jobs", 1, "-q")
DOCS = Path(__file__).parents[2] / "docs"


def run(folder: Path, *arguments: object) -> Done:
    return worked("run", "standard", *SHORT, *arguments, folder=folder)


@pytest.fixture(scope="module")
def _ground(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("ground")
    (folder / "mine.py").write_text(MINE)
    run(folder, "--detector", "midnet,subtraction", "-o", "reference")
    return folder


@pytest.fixture
def ground(_ground: Path) -> Iterator[Path]:
    """A folder with a detector, where short results of two shipped detectors are the committed ones."""
    with mock.patch.object(standing, "reference_folder", return_value=_ground / "reference"):
        yield _ground


@pytest.mark.slow
def test_a_detector_of_one_s_own_stands_among_the_shipped_ones(ground: Path) -> None:
    first = run(ground, "--detector", "mine.py:Returns", "-o", "mine")
    table = rows(ground / "mine" / "leaderboard.csv")
    assert {row["method"] for row in table} == {"midnet", "subtraction", "mine.py:Returns (yours)"}
    scores = [float(row["f1_one_to_one"]) for row in table]
    assert scores == sorted(scores, reverse=True)
    for row in table:
        grounds = [float(row[name]) for name in ("Map 1", "office", "people", "standing still")]
        assert float(row["f1_one_to_one"]) == pytest.approx(sum(grounds) / 4.0)
    (own,) = (row for row in table if row["method"].endswith("(yours)"))
    again = worked("report", "mine", "-q", folder=ground)
    assert own["digest"] in first.stdout
    assert own["digest"] in again.stdout


@pytest.mark.slow
def test_a_shipped_method_again_has_the_committed_scores_or_says_that_it_has_not(ground: Path) -> None:
    assert "to the last bit" in run(ground, "-o", "same").stdout
    path = ground / "reference" / "scores.csv"
    (ground / "reference" / "campaign.sqlite").unlink()
    before, frame = path.read_bytes(), pd.read_csv(path)
    frame.loc[0, "gospa_m"] += 1e-9
    frame.to_csv(path, index=False)
    assert "differ" in worked("report", "same", "-q", folder=ground).stdout
    path.write_bytes(before)


@pytest.mark.slow
def test_another_protocol_has_no_place(ground: Path) -> None:
    done = run(ground, "--set", "obstacle_range_m=2", "-o", "other")
    assert not (ground / "other" / "leaderboard.csv").exists()
    assert "rank" not in done.stdout


def test_the_packaged_campaign_keeps_to_the_protocol_of_the_committed_results() -> None:
    campaign = load_campaign(DOCS.parent / "campaigns" / "standard.yaml")
    assert standing.is_standard(resolve(campaign, registry).definition)


@pytest.mark.slow
def test_the_committed_page_is_made_of_the_committed_results() -> None:
    folder = standing.reference_folder()
    results = load_results(folder, tables_of)
    definition = Definition.from_json((folder / "configuration.json").read_text())
    assert standing.is_standard(definition)
    table = standing.standing(results, standing._stored_costs(folder))
    assert standing.page(table) == (DOCS / "leaderboard.md").read_text(encoding="utf-8")
    assert json.loads((folder / "provenance.json").read_text())[0]["command"].startswith(
        "midnet-bench run standard"
    )
