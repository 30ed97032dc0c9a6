"""Trials that share a simulation: each is what it is alone, and only the guilty one fails."""

import functools
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest

from midnet_bench.campaign.definition import Campaign, ResolvedCampaign, resolve
from midnet_bench.campaign.pool import attempt
from midnet_bench.campaign.runner import MOST_TOGETHER, pending_trials, run_campaign
from midnet_bench.campaign.store import Inventory, StoredTrial, open_or_create, open_store
from midnet_bench.campaign.trial import TrialResult, TrialSpec, encode_tables
from tests.campaign import coin_experiments as coins

BIASES = [0.2, 0.4, 0.6, 0.8]


def campaign(trouble: Sequence[str] = ("",), **keys: Any) -> ResolvedCampaign:
    """Two seeds of coins whose tosses are shared by all biases."""
    values = {
        "experiment": "coins",
        "grid": {"coins": [2, 5], "bias": BIASES, "trouble": list(trouble)},
        "trials": 2,
        "parameters": {"trouble_seed": 2},
        **keys,
    }
    return resolve(Campaign.model_validate(values), coins)


def alone(resolved: ResolvedCampaign) -> dict[str, bytes | None]:
    """Trial id -> its bytes when nobody shares its work; None for one that raises."""
    outcomes = (attempt(resolved.run_trials, [spec], 60.0)[0] for spec in resolved.trials())
    return {outcome.trial_id: outcome.payload for outcome in outcomes}


def stored(directory: Path) -> dict[str, StoredTrial]:
    with open_store(directory / "campaign.sqlite") as store:
        return {trial.trial_id: trial for trial in store.trials()}


def groups(resolved: ResolvedCampaign, inventory: Inventory | None = None) -> list[list[TrialSpec]]:
    _, missing = pending_trials(resolved, inventory or Inventory({}, {}, {}), False, 2)
    return [list(group) for group in missing]


def test_cells_that_differ_in_what_does_not_toss_come_together() -> None:
    found = groups(campaign())
    assert [len(group) for group in found] == [4] * 4
    for group in found:
        assert len({(spec.seed, spec.parameters["coins"]) for spec in group}) == 1
        assert [spec.parameters["bias"] for spec in group] == BIASES


def test_no_more_than_memory_holds_come_together() -> None:
    many = campaign(grid={"bias": [place / 1000 for place in range(MOST_TOGETHER + 5)]}, trials=1)
    assert [len(group) for group in groups(many)] == [MOST_TOGETHER, 5]


@pytest.mark.parametrize("jobs", [1, 2])
def test_shared_trials_have_the_bytes_that_they_have_alone(tmp_path: Path, jobs: int) -> None:
    resolved = campaign()
    run_campaign(resolved, tmp_path, jobs=jobs)
    assert {trial_id: trial.payload for trial_id, trial in stored(tmp_path).items()} == alone(resolved)


@pytest.mark.parametrize("seed", range(3))
def test_any_subset_may_be_there_already(tmp_path: Path, seed: int) -> None:
    resolved, chance = campaign(), Random(seed)
    with open_or_create(tmp_path / "campaign.sqlite", resolved.definition) as store:
        run_id = store.begin_run({})
        for spec in resolved.trials():
            if chance.random() < 0.5:
                store.record(run_id, spec, attempt(resolved.run_trials, [spec], 60.0)[0])
        there = sum(store.counts())
    outcome = run_campaign(resolved, tmp_path, jobs=1)
    assert outcome.ran == len(resolved.cells) * 2 - there
    assert {trial_id: trial.payload for trial_id, trial in stored(tmp_path).items()} == alone(resolved)


@pytest.mark.slow
@pytest.mark.parametrize("trouble", ["raise", "refuse", "odd", "exit", "segfault"])
def test_one_that_fails_takes_no_other_along(tmp_path: Path, trouble: str) -> None:
    resolved = campaign(("", trouble))
    outcome = run_campaign(resolved, tmp_path, jobs=1)
    found = stored(tmp_path)
    failed = {trial_id for trial_id, trial in found.items() if trial.status == "failed"}
    guilty = {spec.trial_id for spec in resolved.trials() if spec.parameters["trouble"] and spec.seed == 2}
    assert failed == guilty
    assert outcome.failed == len(guilty) == 2 * len(BIASES)
    if trouble != "segfault":
        assert {trial_id: trial.payload for trial_id, trial in found.items()} == alone(resolved)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["spin", "native"])
def test_a_group_that_takes_too_long_is_taken_apart(tmp_path: Path, how: str) -> None:
    """Also where native code cannot be interrupted, and the worker ends."""
    resolved = campaign(grid={"bias": [0.2, 0.4], "trouble": ["", how]}, trial_timeout_s=0.5)
    run_campaign(resolved, tmp_path, jobs=1)
    failed = [trial for trial in stored(tmp_path).values() if trial.status == "failed"]
    assert [(trial.seed, trial.parameters["trouble"]) for trial in failed] == [(2, how)] * 2
    assert all("after its limit of 0.5 s" in trial.reason for trial in failed)


def test_the_time_of_a_group_is_parted_evenly() -> None:
    (group, *_) = groups(campaign(parameters={"work_s": 0.2}))
    times = [one.wall_s for one in attempt(coins.run_trials, group, 60.0)]
    assert len(set(times)) == 1
    assert 0.2 <= sum(times) < 0.4


def in_vain(specs: Sequence[TrialSpec], calls: list[int]) -> list[TrialResult | Exception]:
    """Groups cannot be run."""
    calls.append(len(specs))
    if len(specs) > 1:
        raise RuntimeError("no room for several")
    return coins.run_trials(specs)


def test_where_a_group_cannot_be_run_each_trial_is() -> None:
    (group, *_) = groups(campaign())
    calls: list[int] = []
    outcomes = attempt(functools.partial(in_vain, calls=calls), group, 60.0)
    assert calls == [4, 1, 1, 1, 1]
    assert [one.payload for one in outcomes] == [encode_tables(coins.run_trial(spec)) for spec in group]
