"""The commands that read a campaign's folder, and what they say when there is nothing to tell."""

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest

from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.payload import encode_tables
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.store import open_or_create
from midnet_bench.campaign.trial import Row, Scalar, TrialResult, TrialSpec
from midnet_bench.campaign.worker import Outcome
from tests.cli.command import midnet_bench
from tests.stores import NO_CAUSES, labyrinth_store, robot_row

Command = Callable[..., tuple[int, str, list[str]]]


@pytest.fixture
def command(tmp_path: Path) -> Command:
    """Runs ``midnet-bench`` here: exit code, what it printed, and its lines on stderr."""

    def run(*arguments: object) -> tuple[int, str, list[str]]:
        done = midnet_bench(*arguments, folder=tmp_path)
        return done.returncode, done.stdout, done.stderr.splitlines()

    return run


def detection_store(folder: Path, seeds: range, failure: str | None = None) -> None:
    """Trials of one robot at ``seeds``, all alike."""
    folder.mkdir(parents=True)
    definition = Definition("detection", seeds[0], len(seeds), {"robots": [1]}, {})
    counts: Row = {
        "tp": 9,
        "fp": 1,
        "fn": 9,
        "intruders_in_range": 18,
        "matched": 9,
        "duplicates": 0,
        "missed": 9,
    }
    counts |= {"error_sum_m": 0.9, "gospa_m": 5.0}
    scores = {"frames": 10, **counts, "precision": 0.9, "recall": 0.5, "f1": math.nan, **NO_CAUSES}
    robots = [robot_row("guard", 2.0, stuck_s=0.0)]
    tables = {"scores": [scores], "frames": [{"frame": 1, **counts}], "robots": robots}
    payload = encode_tables(TrialResult(tables, 2.0))
    with open_or_create(folder / "campaign.sqlite", definition) as store:
        run_id = store.begin_run(collect(1))
        for seed in seeds:
            spec = TrialSpec("detection", {"robots": 1}, seed)
            outcome = (
                Outcome(spec.trial_id, 1.0, failure=failure)
                if failure
                else Outcome(spec.trial_id, 1.0, 2.0, payload)
            )
            store.record(run_id, spec, outcome)


def test_what_is_no_campaigns_folder_gets_a_hint(tmp_path: Path, command: Command) -> None:
    detection_store(tmp_path / "one", range(1, 3))
    for name in ("report", "verify", "errors", "compare"):
        code, _, (line,) = command(name, "one/campaign.sqlite")
        assert (code, "give the campaign's folder, one" in line) == (2, True), line
        code, _, (line,) = command(name, "two")
        assert (code, "two: there is no such folder" in line) == (2, True), line


def test_trials_of_two_versions_of_the_code_are_noted_by_each_command_that_reads_them(
    tmp_path: Path, command: Command
) -> None:
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
        assert any(told in line for line in command(*arguments)[2]), arguments
    (tmp_path / "one" / "campaign.sqlite").unlink()  # the report's files say it too
    assert any(told in line for line in command("verify", "one")[2])


def test_two_equal_team_sizes_are_refused(tmp_path: Path, command: Command) -> None:
    detection_store(tmp_path / "one", range(1, 3))
    code, _, (line,) = command("verify", "one", "--difference", 5, "--robots", "4,4")
    assert (code, "--robots 4 4" in line) == (2, True), line


def test_a_report_of_nothing_says_so(tmp_path: Path, command: Command) -> None:
    detection_store(tmp_path / "failed", range(1, 3), failure="ValueError: no")
    code, out, (line,) = command("report", "failed")
    assert (code, out, line) == (2, "", "error: failed: no finished trial yet; see failures.csv there")
    assert (tmp_path / "failed" / "failures.csv").exists()


def test_a_comparison_without_a_common_seed_says_so(tmp_path: Path, command: Command) -> None:
    detection_store(tmp_path / "one", range(1, 3))
    detection_store(tmp_path / "other", range(3, 5))
    code, out, (line,) = command("compare", "one", "other")
    assert (code, out) == (2, "")
    assert line == (
        "error: nothing to pair: one has seeds 1 to 2, other has seeds 3 to 4; run other with --seed 1"
    )


def test_numbers_that_are_not_defined_are_null_in_json_and_names_stay(
    tmp_path: Path, command: Command
) -> None:
    for name in ("one", "NaNcy"):
        detection_store(tmp_path / name, range(1, 3))
    code, out, _ = command("compare", "one", "NaNcy", "--json")
    assert code == 0
    told = json.loads(out)
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
