"""Trials that share a simulation: each is what it is alone, and only the guilty one fails."""

import functools
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

import pytest

from midnet_bench.campaign.child import attempt
from midnet_bench.campaign.definition import Campaign, ResolvedCampaign, resolve
from midnet_bench.campaign.runner import MOST_TOGETHER, pending_trials, run_campaign
from midnet_bench.campaign.store import Inventory, open_or_create, open_store
from midnet_bench.campaign.trial import TrialResult, TrialSpec, encode_tables
from tests.campaign import coin_experiments as coins
from tests.campaign.campaign_process import alone, payloads

slow = pytest.mark.slow
BIASES = [0.2, 0.4, 0.6, 0.8]


def campaign(**keys: Any) -> ResolvedCampaign:
    """Two seeds of coins whose tosses are shared by all biases."""
    values = {
        "experiment": "coins",
        "grid": {"coins": [2, 5], "bias": BIASES},
        "trials": 2,
        "parameters": {"trouble_seed": 2},
        **keys,
    }
    return resolve(Campaign.model_validate(values), coins)


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


def test_shared_trials_have_the_bytes_that_they_have_alone(tmp_path: Path) -> None:
    resolved = campaign()
    run_campaign(resolved, tmp_path, jobs=2)
    assert payloads(tmp_path) == alone(resolved)


def test_any_subset_may_be_there_already(tmp_path: Path) -> None:
    resolved, chance = campaign(), Random(1)
    with open_or_create(tmp_path / "campaign.sqlite", resolved.definition) as store:
        run_id = store.begin_run({})
        for spec in resolved.trials():
            if chance.random() < 0.5:
                store.record(run_id, spec, attempt(resolved.run_trials, [spec])[0])
        there = sum(store.counts())
    outcome = run_campaign(resolved, tmp_path, jobs=1)
    assert outcome.ran == len(resolved.cells) * 2 - there
    assert payloads(tmp_path) == alone(resolved)


@pytest.mark.parametrize(
    ("trouble", "reason", "where"),
    [
        ("raise", "ValueError: the coin stands on its edge", "make_trouble"),
        ("odd", "ValueError: trial: 'heads': neither a number nor a text", "encode_tables"),
        ("exit", "SystemExit: 3", "make_trouble"),
        ("spin", "still running after its limit of 1 s of wall time", "Timeout"),
        pytest.param("native", "still running after its limit of 1 s of wall time", "Timeout", marks=slow),
        pytest.param("segfault", "its worker died twice", "Segmentation fault", marks=slow),
    ],
)
def test_one_that_fails_takes_no_other_along(tmp_path: Path, trouble: str, reason: str, where: str) -> None:
    """``native``: code that looks at no signal."""
    resolved = campaign(grid={"bias": [0.2, 0.4], "trouble": ["", trouble]}, trial_timeout_s=1.0)
    outcome = run_campaign(resolved, tmp_path, jobs=2)
    guilty = {spec.trial_id for spec in resolved.trials() if spec.parameters["trouble"] and spec.seed == 2}
    assert (outcome.finished, outcome.failed) == (6, 2)
    with open_store(tmp_path / "campaign.sqlite") as store:
        failed = {trial.trial_id: trial for trial in store.trials() if trial.status == "failed"}
    assert failed.keys() == guilty
    for trial in failed.values():
        assert reason in trial.reason
        assert "make_trouble" in trial.traceback or trouble == "odd"
        assert where in trial.traceback
    innocent = [spec for spec in resolved.trials() if spec.trial_id not in guilty]
    wanted = {spec.trial_id: encode_tables(coins.run_trial(spec)) for spec in innocent}
    assert payloads(tmp_path) == {**wanted, **dict.fromkeys(guilty)}


def test_the_time_of_a_group_is_parted_evenly() -> None:
    (group, *_) = groups(campaign(parameters={"work_s": 0.1}))
    times = [one.wall_s for one in attempt(coins.run_trials, group)]
    assert len(set(times)) == 1
    assert 0.1 <= sum(times) < 0.3


def in_vain(specs: Sequence[TrialSpec], calls: list[int]) -> list[TrialResult | Exception]:
    """Groups cannot be run."""
    calls.append(len(specs))
    if len(specs) > 1:
        raise RuntimeError("no room for several")
    return coins.run_trials(specs)


def test_where_a_group_cannot_be_run_each_trial_is() -> None:
    (group, *_) = groups(campaign())
    calls: list[int] = []
    outcomes = attempt(functools.partial(in_vain, calls=calls), group)
    assert calls == [4, 1, 1, 1, 1]
    assert [one.payload for one in outcomes] == [encode_tables(coins.run_trial(spec)) for spec in group]
