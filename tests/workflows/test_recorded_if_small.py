"""Small detection campaigns keep their frames without being asked, and nothing else of them changes."""

from dataclasses import replace

import pytest

from midnet_bench.campaign.definition import Campaign, parse_campaign, resolve
from midnet_bench.campaign.trial import TrialResult
from midnet_bench.experiments import registry
from midnet_bench.workflows.campaigns import RECORDED_TRIALS, recorded_if_small


def campaign(trials: int = 1, experiment: str = "detection", **parameters: object) -> Campaign:
    given = {"engine": "fast", **({"frames": 4} if experiment == "detection" else {}), **parameters}
    content = {"experiment": experiment, "grid": {"robots": [1]}, "parameters": given, "trials": trials}
    return parse_campaign({**content, "base_seed": 3}, "test")


def test_recording_adds_tables_and_changes_no_other_byte_and_no_id() -> None:
    plain = resolve(campaign(), registry)
    kept = recorded_if_small(plain)
    assert (kept.definition, kept.cells) == (plain.definition, plain.cells)
    specs = list(kept.trials())
    assert [spec.trial_id for spec in specs] == [spec.trial_id for spec in plain.trials()]
    (without,), (recorded,) = plain.run_trials(specs), kept.run_trials(specs)
    assert isinstance(without, TrialResult)
    assert isinstance(recorded, TrialResult)
    assert "recorded" not in without.tables
    assert len(recorded.tables["recorded"]) == 4
    added = {"recorded", "errors"}
    assert {name: rows for name, rows in recorded.tables.items() if name not in added} == without.tables


@pytest.mark.parametrize(
    "other",
    [
        campaign(trials=RECORDED_TRIALS + 1),
        campaign(experiment="labyrinth"),
        campaign(message_delay_s=0.1),
    ],
)
def test_large_campaigns_other_ones_and_those_with_a_network_are_not_recorded(other: Campaign) -> None:
    resolved = resolve(other, registry)
    assert recorded_if_small(resolved).run_trials is resolved.run_trials
    assert replace(resolved, run_trials=recorded_if_small(resolved).run_trials) == resolved
