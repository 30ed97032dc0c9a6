"""Stores of earlier versions: they open, go on and report with the bytes that they always had."""

import sqlite3
from pathlib import Path

import pytest

from midnet_bench.campaign.definition import Campaign, resolve
from midnet_bench.campaign.export import export_csv
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.runner import plan, run_campaign
from midnet_bench.campaign.store import open_or_create, open_store
from midnet_bench.campaign.worker import attempt
from midnet_bench.errors import InputError
from tests.campaign import coin_experiments as coins
from tests.campaign.old_stores import as_schema_1

KEYS = {"grid": {"coins": [2, 1], "table": ["wood", "glass"]}, "trials": 3}
TROUBLE = {"parameters": {"trouble": "raise", "trouble_seed": 2}}
CAMPAIGN = resolve(Campaign.model_validate({"experiment": "coins", **KEYS, **TROUBLE}), coins)


def exported(path: Path, folder: Path) -> dict[str, bytes]:
    with open_store(path) as store:
        return {file.name: file.read_bytes() for file in export_csv(store, folder)}


@pytest.fixture
def new(tmp_path: Path) -> Path:
    """A store of this version: eight trials finished, four failed."""
    path = tmp_path / "new.sqlite"
    with open_or_create(path, CAMPAIGN.definition) as store:
        run_id = store.begin_run(collect(1))
        for spec in CAMPAIGN.trials():
            store.record(run_id, spec, attempt(coins.run_trials, spec, 60.0, None))
        store.end_run(run_id)
    return path


@pytest.fixture
def old(tmp_path: Path, new: Path) -> Path:
    """The same trials in a store of 0.1.0."""
    return as_schema_1(new, tmp_path / "campaign.sqlite")


def test_an_old_store_reports_the_same_bytes(tmp_path: Path, old: Path, new: Path) -> None:
    tables = exported(old, tmp_path / "old")
    assert tables == exported(new, tmp_path / "new")
    assert set(tables) == {"trial.csv", "tosses.csv", "timing.csv", "failures.csv"}
    assert tables == exported(old, tmp_path / "again")
    with open_store(old) as store, open_store(new) as as_made_today:
        assert store.runs() == as_made_today.runs()
        assert store.statuses() == as_made_today.statuses()


def test_an_old_store_goes_on_where_it_stopped(tmp_path: Path, old: Path) -> None:
    connection = sqlite3.connect(old)
    connection.execute("DELETE FROM trials WHERE seed = 3")
    connection.commit()
    connection.close()

    assert plan(CAMPAIGN, tmp_path).to_run == 4
    outcome = run_campaign(CAMPAIGN, tmp_path, jobs=2)

    assert (outcome.ran, outcome.finished, outcome.failed) == (4, 8, 4)
    with open_store(old) as store:
        assert [trial.seed for trial in store.trials()] == [1, 2, 3] * 4


@pytest.mark.parametrize(
    ("column", "value"),
    [("result", b"x\x9c"), ("parameters", "{}"), ("parameters", "{"), ("seed", 77), ("trial_id", "f" * 16)],
)
def test_a_damaged_trial_of_an_old_store_alone_is_run_again(
    tmp_path: Path, old: Path, new: Path, column: str, value: object
) -> None:
    connection = sqlite3.connect(old)
    connection.execute(f"UPDATE trials SET {column} = ? WHERE status = 'finished' AND rowid < 3", (value,))
    assert connection.total_changes == 1
    connection.commit()
    connection.close()

    with pytest.raises(InputError, match="cannot be read, the file is damaged there"):
        exported(old, tmp_path / "damaged")
    assert run_campaign(CAMPAIGN, tmp_path, jobs=2).ran == 1
    tables, wanted = exported(old, tmp_path / "old"), exported(new, tmp_path / "new")
    del tables["timing.csv"], wanted["timing.csv"]
    assert tables == wanted


def test_an_old_store_that_does_not_say_what_it_is_about_is_refused_and_left_alone(old: Path) -> None:
    connection = sqlite3.connect(old)
    connection.execute("UPDATE campaign SET definition = '{'")
    connection.commit()
    connection.close()
    before = old.read_bytes()

    with pytest.raises(InputError, match="which campaign it holds cannot be read"):
        open_store(old)
    assert old.read_bytes() == before
