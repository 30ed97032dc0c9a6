"""The commands that read a campaign's folder, and what they say when there is nothing to tell."""

import json
import math
from pathlib import Path

import pytest

from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.trial import Outcome, Scalar, TrialSpec
from tests.cli.command import midnet_bench, one_line_of_complaint, unpainted, worked
from tests.stores import detection_store, labyrinth_store

SCORES = {1: dict.fromkeys((1, 2), (0.9, 0.5, math.nan))}


@pytest.mark.parametrize("name", ["report", "verify", "errors", "compare"])
def test_what_is_no_campaigns_folder_gets_a_hint(name: str, tmp_path: Path) -> None:
    detection_store(tmp_path / "one", SCORES)
    for place, said in (
        ("one/campaign.sqlite", "give a campaign's folder, one"),
        ("two", "two: there is no such folder"),
    ):
        assert said in one_line_of_complaint(midnet_bench(name, place, folder=tmp_path))


@pytest.mark.slow
def test_trials_of_two_versions_of_the_code_are_noted_by_each_command_that_reads_them(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    grid: dict[str, list[Scalar]] = {"intruders": [1], "robots": [1, 2]}
    with labyrinth_store(
        tmp_path / "one" / "campaign.sqlite", lambda intruders, robots, seed: 1, seeds=2, grid=grid
    ) as store:
        later = store.begin_run({**collect(1), "commit": "0" * 40})
        first = next(store.trials())
        outcome = Outcome(first.trial_id, 1.0, 2.0, first.payload)
        store.record(later, TrialSpec("labyrinth", first.parameters, first.seed), outcome)
    told = "one: note: these trials were run by 2 versions of the code"
    for arguments in (("report", "one"), ("verify", "one"), ("compare", "one", "--by", "robots")):
        with unpainted():
            assert told in midnet_bench(*arguments, folder=tmp_path).stderr, arguments
    (tmp_path / "one" / "campaign.sqlite").unlink()  # the report's files say it too
    assert told in midnet_bench("verify", "one", folder=tmp_path).stderr


def test_a_report_of_nothing_says_so(tmp_path: Path) -> None:
    detection_store(tmp_path / "failed", SCORES, failure="ValueError: no")
    complaint = one_line_of_complaint(midnet_bench("report", "failed", folder=tmp_path))
    assert complaint == "error: failed: no finished trial yet; see failures.csv there"
    assert (tmp_path / "failed" / "failures.csv").exists()


def test_numbers_that_are_not_defined_are_null_in_json_and_names_stay(tmp_path: Path) -> None:
    for name in ("one", "NaNcy"):
        detection_store(tmp_path / name, SCORES)
    done = worked("compare", "one", "NaNcy", "--json", folder=tmp_path)
    told = json.loads(done.stdout)
    assert (told["schema"], told["experiment"], list(told["tables"])) == (
        1,
        "detection",
        ["differences", "settings"],
    )
    rows = told["tables"]["differences"]
    f1 = next(row for row in rows if row["measure"] == "f1")
    assert f1["NaNcy"] is None
    assert f1["difference"] == {"value": None, "low": None, "high": None, "n": 0}
    assert next(row for row in rows if row["measure"] == "recall")["NaNcy"] == 0.5
