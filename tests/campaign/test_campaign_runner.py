import csv
import os
import re
import sqlite3
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import midnet_bench
from midnet_bench.campaign.definition import Campaign, ResolvedCampaign, resolve
from midnet_bench.campaign.pool import LocalPool
from midnet_bench.campaign.runner import (
    CampaignOutcome,
    Interrupted,
    Progress,
    pending_trials,
    plan,
    run_campaign,
)
from midnet_bench.campaign.store import Inventory, StoredTrial, open_store
from midnet_bench.campaign.trial import Outcome, TrialResult, TrialSpec, decode_tables
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from tests.campaign import coin_experiments as coins
from tests.campaign.campaign_process import environment, exported
from tests.campaign.coin_trial import leave_rings

GRID = {"coins": [1, 2, 3], "table": ["wood", "glass"]}


class Listener(Progress):
    def __init__(self) -> None:
        self.begun: list[tuple[int, int]] = []
        self.outcomes: list[Outcome] = []
        self.notes: list[str] = []
        self.ended = 0

    def begin(self, total: int, done: int) -> None:
        self.begun.append((total, done))

    def advance(self, outcome: Outcome) -> None:
        self.outcomes.append(outcome)

    def note(self, text: str) -> None:
        self.notes.append(text)

    def end(self) -> None:
        self.ended += 1


def run(directory: Path, options: dict[str, Any] | None = None, **keys: object) -> CampaignOutcome:
    """A campaign of coins with ``keys`` of a campaign file, on two workers unless the options differ."""
    return run_campaign(coin_campaign(**keys), directory, **{"jobs": 2, **(options or {})})


def coin_campaign(**keys: object) -> ResolvedCampaign:
    values = {"experiment": "coins", "grid": GRID, "trials": 3, **keys}
    return resolve(Campaign.model_validate(values), coins)


def stored(directory: Path) -> list[StoredTrial]:
    with open_store(directory / "campaign.sqlite") as store:
        return list(store.trials())


def failures(directory: Path) -> dict[int, str]:
    """Seed -> traceback; every failure of these tests is one seed's."""
    return {trial.seed: trial.traceback for trial in stored(directory) if trial.traceback is not None}


def test_one_worker_and_two_give_the_same_bytes(tmp_path: Path) -> None:
    listener = Listener()
    first = run(tmp_path / "one", {"jobs": 1})
    second = run(tmp_path / "two", {"progress": listener})

    assert (
        (first.finished, first.failed, first.ran)
        == (second.finished, second.failed, second.ran)
        == (18, 0, 18)
    )
    assert exported(tmp_path / "one") == exported(tmp_path / "two")
    assert set(exported(tmp_path / "one")) == {"trial.csv", "tosses.csv"}
    run(tmp_path / "three", base_seed=100)
    assert exported(tmp_path / "one")["tosses.csv"] != exported(tmp_path / "three")["tosses.csv"]
    assert listener.begun == [(18, 0)]
    assert len(listener.outcomes) == 18
    assert listener.ended == 1


def begun(campaign: ResolvedCampaign, workers: int) -> list[tuple[int, int]]:
    """(effort, seed) in the order in which the trials of a new campaign are begun."""
    nothing = Inventory({}, {}, {})
    efforts = dict(zip(map(id, campaign.cells), (one.effort for one in campaign.checked), strict=True))
    _, groups = pending_trials(campaign, nothing, False, workers)
    missing = [spec for group in groups for spec in group]
    assert {spec.trial_id for spec in missing} == {spec.trial_id for spec in campaign.trials()}
    return [(round(efforts[id(spec.parameters)]), spec.seed) for spec in missing]


def test_trials_that_take_longest_are_begun_first() -> None:
    """Of each seed; and of the whole campaign, where there are few for each worker."""
    values = {"experiment": "detection", "grid": {"robots": [1, 5, 2]}, "trials": 7}
    campaign = resolve(Campaign.model_validate(values), registry)
    assert begun(campaign, 2) == [(robots, seed) for seed in range(1, 8) for robots in (5, 2, 1)]
    assert begun(campaign, 3) == [(robots, seed) for robots in (5, 2, 1) for seed in range(1, 8)]


class Stopping(Listener):
    """Ctrl-C after the first trial, and the time at which that was stored."""

    def advance(self, outcome: Outcome) -> None:
        super().advance(outcome)
        self.cpu_s = time.process_time()
        raise KeyboardInterrupt


@pytest.mark.slow
def test_a_million_trials_of_each_cell_begin_at_once_and_go_on(tmp_path: Path) -> None:
    for done in (0, 1):
        listener, cpu_s = Stopping(), time.process_time()
        with pytest.raises(Interrupted, match=rf"{done + 1} of 6000000 trials are stored"):
            run(tmp_path, {"progress": listener}, trials=1_000_000)
        assert listener.begun == [(6_000_000, done)]
        assert listener.cpu_s - cpu_s < 2.0
    assert [trial.seed for trial in stored(tmp_path)] == [1, 1]
    assert len(exported(tmp_path)["trial.csv"].splitlines()) == 3
    assert plan(coin_campaign(trials=1_000_000), tmp_path).to_run == 5_999_998


def test_the_tidy_tables_lead_with_factors_and_seed(tmp_path: Path) -> None:
    run(tmp_path)
    tables = exported(tmp_path)
    rows = list(csv.DictReader(tables["tosses.csv"].decode().splitlines()))

    assert list(rows[0]) == ["coins", "table", "seed", "toss", "height_m"]
    assert len(rows) == (1 + 2 + 3) * 2 * 3
    world = {(row["seed"], row["toss"]): row["height_m"] for row in rows}
    assert all(world[row["seed"], row["toss"]] == row["height_m"] for row in rows)  # cells share their worlds
    assert tables["trial.csv"].splitlines()[1] == b"1,wood,1,1,1.0,"
    timing = (tmp_path / "csv" / "timing.csv").read_text().splitlines()
    assert timing[0] == "coins,table,seed,status,wall_s,simulated_s,finished_utc"
    assert len(timing) == 19


def test_the_same_again_runs_nothing_and_an_extension_runs_the_rest(tmp_path: Path) -> None:
    run(tmp_path, trials=2)
    assert run(tmp_path, trials=2).ran == 0
    assert run(tmp_path, trials=3).ran == 6
    run(tmp_path / "at_once", trials=3)
    assert exported(tmp_path) == exported(tmp_path / "at_once")


def test_a_damaged_trial_alone_is_run_again(tmp_path: Path) -> None:
    run(tmp_path)
    sound = exported(tmp_path)
    connection = sqlite3.connect(tmp_path / "campaign.sqlite")
    connection.execute("UPDATE trials SET result = substr(result, 1, length(result) / 2) WHERE rowid = 4")
    connection.commit()
    connection.close()
    assert plan(coin_campaign(), tmp_path).to_run == 1
    listener = Listener()

    again = run(tmp_path, {"progress": listener})

    assert (again.ran, again.finished) == (1, 18)
    (note,) = listener.notes
    assert "campaign.sqlite: damaged; what cannot be read is run again: trial " in note
    assert exported(tmp_path) == sound


def test_starting_over_keeps_the_old_store(tmp_path: Path) -> None:
    run(tmp_path)
    listener = Listener()

    again = run(tmp_path, {"progress": listener, "fresh": True}, parameters={"bias": 0.9})

    assert again.ran == 18
    with open_store(tmp_path / "campaign.old-1.sqlite") as old:
        assert old.definition.parameters["bias"] == 0.5
    assert "campaign.old-1.sqlite" in listener.notes[0]


@pytest.mark.parametrize(
    ("trouble", "last_line"),
    [
        ("raise", "ValueError: the coin stands on its edge"),
        ("exit", "SystemExit: 3"),
        ("odd", "ValueError: trial: 'heads': neither a number nor a text"),
    ],
)
def test_a_trial_that_raises_is_stored_as_failed(tmp_path: Path, trouble: str, last_line: str) -> None:
    outcome = run(tmp_path, parameters={"trouble": trouble, "trouble_seed": 2})

    assert (outcome.finished, outcome.failed) == (12, 6)
    assert failures(tmp_path)[2].splitlines()[-1] == last_line
    assert "Traceback" in failures(tmp_path)[2]
    tables = exported(tmp_path)
    assert b"\n1,wood,2," not in tables["trial.csv"]  # never counted as zero
    assert len(tables["failures.csv"].splitlines()) == 7


def test_input_that_no_trial_can_use_is_told_apart_from_failures(tmp_path: Path) -> None:
    grid = {"coins": [1, 2]}
    refused = run(tmp_path / "a", grid=grid, parameters={"trouble": "refuse", "trouble_seed": 2})
    raised = run(tmp_path / "b", grid=grid, parameters={"trouble": "raise", "trouble_seed": 2})

    assert (refused.failed, refused.unusable) == (2, {"table: nothing stands on it": 2})
    assert (raised.failed, raised.unusable) == (2, {})
    reasons = exported(tmp_path / "a")["failures.csv"].decode().splitlines()[1:]
    assert all(row.endswith("midnet_bench.errors.InputError: table: nothing stands on it") for row in reasons)


def test_failures_are_tried_again_on_request_alone(tmp_path: Path) -> None:
    trouble = {"trouble": "first", "trouble_seed": 1, "trouble_file": str(tmp_path / "been_here")}
    grid = {"coins": [4]}
    assert run(tmp_path, grid=grid, parameters=trouble).failed == 1
    assert run(tmp_path, grid=grid, parameters=trouble).ran == 0

    again = run(tmp_path, {"retry_failed": True}, grid=grid, parameters=trouble)

    assert (again.ran, again.finished, again.failed) == (1, 3, 0)
    assert "failures.csv" not in exported(tmp_path)


@pytest.mark.slow
def test_a_worker_that_is_killed_costs_its_trial_one_repetition(tmp_path: Path) -> None:
    listener = Listener()
    trouble = {"trouble": "once", "trouble_seed": 2, "trouble_file": str(tmp_path / "been_here")}

    outcome = run(tmp_path, {"progress": listener}, parameters=trouble)

    assert (outcome.finished, outcome.failed) == (18, 0)
    assert listener.notes == ["a worker died; what it ran is repeated, one at a time (1)"]
    run(tmp_path / "calm")
    assert exported(tmp_path) == exported(tmp_path / "calm")


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_a_process_that_a_trial_leaves_behind_is_not_waited_for(tmp_path: Path) -> None:
    start_s = time.monotonic()
    outcome = run(tmp_path, grid={"coins": [1]}, parameters={"trouble": "desert", "trouble_seed": 2})
    assert (outcome.finished, outcome.failed) == (2, 1)
    assert time.monotonic() - start_s < 300.0


def test_workers_keep_to_one_thread(tmp_path: Path) -> None:
    run(tmp_path, grid={"table": ["threads"]}, trials=1)

    (row,) = stored(tmp_path)[0].tables()["threads"]
    assert set(row.values()) == {1}


def test_two_versions_of_the_code_in_one_store_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(tmp_path, trials=1).notes == []
    monkeypatch.setattr(midnet_bench, "__version__", "9.9")

    (note,) = run(tmp_path, trials=2).notes

    assert "2 versions of the code" in note


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"jobs": 0}, "--jobs 0"),
        ({"backend": "slurm"}, "--backend slurm: unknown; valid: dask, loky"),
        ({"scheduler": "tcp://127.0.0.1:8786"}, "only with --backend dask"),
    ],
)
def test_a_wrong_option_is_refused_before_anything_is_touched(
    tmp_path: Path, options: dict[str, Any], complaint: str
) -> None:
    run(tmp_path, trials=1)
    before = (tmp_path / "campaign.sqlite").read_bytes()

    with pytest.raises(InputError, match=complaint):
        run(tmp_path, {"fresh": True, **options})
    with pytest.raises(InputError, match=complaint):
        plan(coin_campaign(), tmp_path / "new", **options)

    assert (tmp_path / "campaign.sqlite").read_bytes() == before


def test_what_prepares_workers_is_called_once_and_only_where_a_trial_is_missing(tmp_path: Path) -> None:
    called: list[int] = []
    for _ in range(2):
        run_campaign(coin_campaign(), tmp_path, jobs=1, prepare=lambda: called.append(1))
    assert called == [1]


def test_a_plan_counts_what_is_left(tmp_path: Path) -> None:
    ahead = plan(coin_campaign(), tmp_path, jobs=2)
    assert (ahead.cells, ahead.trials, ahead.to_run, ahead.measured_on) == (6, 18, 18, 0)
    assert ahead.wall_s > 0
    assert list(tmp_path.iterdir()) == []

    run(tmp_path, trials=2, parameters={"work_s": 0.02})

    campaign = coin_campaign(parameters={"work_s": 0.02})
    ahead = plan(campaign, tmp_path, jobs=2)
    assert (ahead.finished, ahead.to_run, ahead.measured_on) == (12, 6, 12)
    assert 6 * 0.02 / 2 <= ahead.wall_s < 6
    assert 0 < ahead.disk_bytes < 6 * 1000
    assert plan(campaign, tmp_path, fresh=True).to_run == 18
    with pytest.raises(InputError, match="made by another campaign"):
        plan(coin_campaign(trials=1), tmp_path)


def test_a_missing_dask_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, "midnet_bench.campaign.dask_pool", raising=False)
    wanted = re.escape("--backend dask needs Dask's scheduler: pip install 'midnet-bench[dask]'")
    with pytest.raises(InputError, match=wanted):
        run(tmp_path, {"backend": "dask", "scheduler": "tcp://127.0.0.1:8786"})
    assert not (tmp_path / "campaign.sqlite").exists()


class Unloadable:
    """What can be sent to a worker and not be read there."""

    def __call__(self, specs: Sequence[TrialSpec]) -> list[TrialResult | Exception]:
        raise NotImplementedError

    def __reduce__(self) -> object:
        return int, ("three",)


def test_what_a_worker_cannot_read_is_why_the_trial_fails() -> None:
    groups = iter([[TrialSpec("coins", {}, 1)]])
    (outcome,) = LocalPool(1).outcomes(Unloadable(), groups, 60.0)
    assert str(outcome.failure).endswith("ValueError: invalid literal for int() with base 10: 'three'")


def test_what_a_trial_leaves_in_a_cycle_is_freed_before_the_next() -> None:
    groups = ([TrialSpec("coins", {}, seed)] for seed in range(3))
    outcomes = LocalPool(1).outcomes(leave_rings, groups, 60.0)
    left = [decode_tables(outcome.payload or b"")["trial"][0]["left"] for outcome in outcomes]
    assert left == [0, 0, 0]


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs Linux's /proc to find the workers")
def test_as_many_workers_are_started_as_there_is_work_for_and_no_room_above_is_loaded(tmp_path: Path) -> None:
    """A program of its own, for this one's workers and modules stay."""
    program = (
        "import os, sys\n"
        "from pathlib import Path\n"
        "from midnet_bench.campaign.definition import Campaign, resolve\n"
        "from midnet_bench.campaign.runner import Progress, plan, run_campaign\n"
        "from midnet_bench.campaign.store import export_csv, open_store\n"
        "from tests.campaign import coin_experiments as coins\n"
        "from tests.campaign.campaign_process import children_of\n"
        "class Counting(Progress):\n"
        "    def advance(self, outcome):\n"
        "        found.append(len(children_of(os.getpid())))\n"
        "for trials, jobs in ((3, 1), (1, 2), (40, 2)):\n"
        "    found, directory = [], Path(sys.argv[1]) / f'{trials}'\n"
        "    campaign = resolve(Campaign(experiment='coins', trials=trials), coins)\n"
        "    assert plan(campaign, directory).to_run == trials\n"
        "    run_campaign(campaign, directory, jobs=jobs, progress=Counting())\n"
        "    print(*(found if trials < 4 else {max(found)}))\n"
        "with open_store(directory / 'campaign.sqlite') as store:\n"
        "    export_csv(store, directory)\n"
        "above = ('analysis', 'drawing', 'experiments', 'workflows', 'cli', 'simulation')\n"
        "print([name for name in sys.modules if name.startswith('midnet_bench.') and"
        " name.split('.')[1] in above])\n"
    )
    command = [sys.executable, "-c", program, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment())
    assert (done.stdout.splitlines(), done.stderr) == (["1 1 1", "1", "2", "[]"], "")
    assert (tmp_path / "40" / "trial.csv").exists()
