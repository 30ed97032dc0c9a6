"""``run standard``: a method in its place among the shipped ones."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest import mock

import pandas as pd
import pytest

from midnet_bench.analysis.frames import load_results
from midnet_bench.campaign.definition import Definition, load_campaign, resolve
from midnet_bench.experiments import registry
from midnet_bench.experiments.registry import tables_of
from midnet_bench.workflows import ranking
from tests.cli.command import Done, rows, worked

SHORT = ("--seeds", 1, "--seed", 9101, "--frames", 2, "--jobs", 1, "-q")
DOCS = Path(__file__).parents[2] / "docs"
MINE = """
from midnet_bench.detectors.baselines import MapSubtraction

class Mine(MapSubtraction):
    def __init__(self, prior_map, range_m):
        super().__init__(prior_map, range_m)

    def detect(self, team):
        return [boxes + 0.02 for boxes in super().detect(team)]
"""


def run(folder: Path, *arguments: object) -> Done:
    return worked("run", "standard", *SHORT, *arguments, folder=folder)


@pytest.fixture
def ground(tmp_path: Path, trials_in_this_process: None) -> Iterator[Path]:
    """A folder with a detector, where short results of two shipped detectors are the committed ones."""
    (tmp_path / "mine.py").write_text(MINE)
    run(tmp_path, "--detector", "midnet,subtraction", "-o", "reference")
    with mock.patch.object(ranking, "reference_folder", return_value=tmp_path / "reference"):
        yield tmp_path


@pytest.mark.slow
def test_ones_own_detector_stands_among_the_shipped_ones_and_a_shipped_one_is_compared(ground: Path) -> None:
    first = run(ground, "--detector", "midnet,mine.py:Mine", "-o", "mine")
    table = rows(ground / "mine" / "leaderboard.csv")
    assert {row["method"] for row in table} == {"midnet", "subtraction", "mine.py:Mine (yours)"}
    scores = [float(row["f1_one_to_one"]) for row in table]
    assert scores == sorted(scores, reverse=True)
    for row in table:
        grounds = [float(row[name]) for name in ("Map 1", "office", "people", "standing still")]
        assert float(row["f1_one_to_one"]) == pytest.approx(sum(grounds) / 4.0)
    (own,) = (row for row in table if row["method"].endswith("(yours)"))
    assert own["digest"] in first.stdout
    assert "midnet: every score is the committed one, to the last bit" in first.stdout

    path = ground / "reference" / "scores.csv"
    (ground / "reference" / "campaign.sqlite").unlink()
    frame = pd.read_csv(path)
    frame.loc[0, "gospa_m"] += 1e-9
    frame.to_csv(path, index=False)
    again = worked("report", "mine", "-q", folder=ground)
    assert own["digest"] in again.stdout
    page = (ground / "mine" / "leaderboard.md").read_text(encoding="utf-8")
    assert page.startswith("# Leaderboard\n")

    ranked = worked("compare", "--rank", "mine", "-o", "page.md", "-q", folder=ground)
    assert "mine.py:Mine (yours)" in ranked.stdout
    assert (ground / "page.md").read_text(encoding="utf-8") == page
    assert "midnet: scores differ from the committed ones" in again.stdout


def test_the_packaged_campaign_keeps_to_the_protocol_of_the_committed_results_and_a_changed_one_not() -> None:
    campaign = load_campaign(DOCS.parent / "campaigns" / "standard.yaml")
    definition = resolve(campaign, registry).definition
    assert ranking.is_standard(definition)
    own = {"fusion": "none", "obstacle_range_m": definition.parameters["obstacle_range_m"]}
    assert ranking.is_standard(replace(definition, parameters={**definition.parameters, **own}))
    other = {"obstacle_range_m": 2.0}
    assert not ranking.is_standard(replace(definition, parameters={**definition.parameters, **other}))


@pytest.mark.slow
def test_the_committed_page_is_made_of_the_committed_results() -> None:
    folder = ranking.reference_folder()
    results = load_results(folder, tables_of)
    definition = Definition.from_json((folder / "configuration.json").read_text())
    assert ranking.is_standard(definition)
    table = ranking.standard_table(results)
    assert ranking.standard_page(table) == (DOCS / "leaderboard.md").read_text(encoding="utf-8")
    assert json.loads((folder / "provenance.json").read_text())[0]["command"].startswith(
        "midnet-bench run standard"
    )
