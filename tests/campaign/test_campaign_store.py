import random
import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from midnet_bench.campaign import store as database
from midnet_bench.campaign.child import attempt
from midnet_bench.campaign.definition import Campaign, Definition, resolve
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.store import Store, back_up, only_writer, open_or_create, open_store
from midnet_bench.campaign.trial import Outcome, TrialSpec, encode_tables
from midnet_bench.errors import InputError
from tests.campaign import coin_experiments as coins

CAMPAIGN = Campaign(experiment="coins", grid={"coins": [2, 1], "table": ["wood", "glass"]}, trials=3)


def definition(campaign: Campaign = CAMPAIGN) -> Definition:
    return resolve(campaign, coins).definition


def fill(store: Store, campaign: Campaign = CAMPAIGN) -> None:
    run_id = store.begin_run(collect(campaign.base_seed))
    for spec in reversed(list(resolve(campaign, coins).trials())):
        store.record(run_id, spec, attempt(coins.run_trials, [spec])[0])
    store.end_run(run_id)


def statuses(store: Store) -> dict[str, str]:
    return {trial.trial_id: trial.status for trial in store.trials()}


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("original") / "campaign.sqlite"
    with open_or_create(path, definition()) as store:
        fill(store)
    return path


@pytest.fixture
def filled(tmp_path: Path, original: Path) -> Path:
    """A store of twelve finished trials, for the test alone."""
    return Path(shutil.copy(original, tmp_path))


def test_trials_come_back_whole_and_in_the_campaigns_order(filled: Path) -> None:
    with open_store(filled, is_writer=True) as store:
        stored = list(store.trials())
        (run,) = store.runs()

    assert [(trial.parameters["coins"], trial.parameters["table"], trial.seed) for trial in stored] == [
        (count, table, seed) for count in (2, 1) for table in ("wood", "glass") for seed in (1, 2, 3)
    ]
    for trial in stored:
        spec = TrialSpec("coins", trial.parameters, trial.seed)
        assert trial.trial_id == spec.trial_id
        assert trial.payload == encode_tables(coins.run_trial(spec))
        assert trial.simulated_s == trial.parameters["coins"]
        assert [row["toss"] for row in trial.tables()["tosses"]] == list(
            range(int(trial.parameters["coins"]))
        )
    assert run["seed"] == 1
    assert run["ended_utc"] is not None


def test_a_failure_is_kept_and_a_later_success_takes_its_place(filled: Path) -> None:
    spec = next(iter(resolve(CAMPAIGN, coins).trials()))
    with open_store(filled, is_writer=True) as store:
        store.record(1, spec, Outcome(spec.trial_id, 0.1, failure="ValueError: no"))
        assert statuses(store)[spec.trial_id] == "failed"
        failed = next(trial for trial in store.trials() if trial.trial_id == spec.trial_id)
        assert failed.traceback == "ValueError: no"
        with pytest.raises(ValueError, match="has failed"):
            _ = failed.tables()

        store.record(1, spec, attempt(coins.run_trials, [spec])[0])
        assert set(statuses(store).values()) == {"finished"}
        assert len(statuses(store)) == 12


def test_raising_trials_or_adding_values_extends_the_store(filled: Path) -> None:
    grid = {"coins": [3, 1, 2], "table": ["wood", "glass"]}
    more = Campaign(experiment="coins", grid=grid, trials=4)
    with open_or_create(filled, definition(more)) as store:
        assert store.definition == definition(more)
        assert len(statuses(store)) == 12
        assert [trial.parameters["coins"] for trial in store.trials()] == [1] * 6 + [2] * 6


def test_another_campaign_is_refused_and_nothing_changes(filled: Path) -> None:
    before = filled.read_bytes()
    other = Campaign(**{**CAMPAIGN.model_dump(), "parameters": {"bias": 0.9}})

    with pytest.raises(InputError, match=r"made by another campaign \(bias 0\.5 -> 0\.9\).*-o.*--fresh"):
        open_or_create(filled, definition(other))

    assert filled.read_bytes() == before


def cut(share: float) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])


def of_another_program(path: Path) -> None:
    path.unlink()
    change(path, "CREATE TABLE songs (title TEXT)")


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        *((cut(share), "damaged") for share in (0.02, 0.3, 0.5, 0.9)),
        (lambda path: path.write_bytes(b"trial,tp,fp\n1-robot,3,4\n" * 40), "not a campaign store"),
        (lambda path: path.write_bytes(bytes(5000)), "not a campaign store"),
        (lambda path: path.write_bytes(b"x"), "not a campaign store"),
        (of_another_program, "another program's SQLite file"),
        *(
            (lambda path, number=number: change(path, f"PRAGMA user_version = {number}"), f"format {number}")
            for number in (1, database.FORMAT - 1, database.FORMAT + 1)
        ),
    ],
)
def test_what_is_no_sound_store_of_this_version_is_refused_and_left_alone(
    filled: Path, spoil: Callable[[Path], object], complaint: str
) -> None:
    spoil(filled)
    before = filled.read_bytes()
    for attempt_to_open in (lambda: open_store(filled), lambda: open_or_create(filled, definition())):
        with pytest.raises(InputError, match=rf"campaign\.sqlite: .*{complaint}") as caught:
            attempt_to_open()
        assert "\n" not in str(caught.value)
    assert filled.read_bytes() == before


def change(path: Path, statement: str, *values: object) -> None:
    connection = sqlite3.connect(path)
    connection.execute(statement, values)
    connection.commit()
    connection.close()


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("result", b"x\x9c"),
        ("result", "x"),
        ("cell", 77),
        ("seed", 77),
        ("seed", "one"),
        ("run_id", 2),
        ("simulated_s", None),
        ("wall_s", 0.0),
        ("finished_utc", "tomorrow"),
        ("traceback", "ValueError: no"),
        ("checksum", 0),
    ],
)
def test_a_damaged_trial_is_named_and_can_be_forgotten(filled: Path, column: str, value: object) -> None:
    with open_store(filled, is_writer=True) as store:
        wanted = [trial.trial_id for trial in store.trials()]
    change(filled, f"UPDATE trials SET {column} = ? WHERE rowid = 5", value)

    with open_store(filled, is_writer=True) as store:
        with pytest.raises(
            InputError,
            match=r"campaign\.sqlite: (trial \w{16} \(seed \d+\)|row 5) cannot be read, .* again to mend it",
        ):
            _ = [trial.tables() for trial in store.trials()]
        assert list(store.inventory().damaged) == [5]
        store.forget([5])
        kept = [trial.trial_id for trial in store.trials() if trial.tables()]
    assert len(kept) == 11
    assert set(kept) < set(wanted)


@pytest.mark.parametrize("damage", ["parameters = '{'", "parameters = '{}'", "cell = cell + 1"])
def test_the_parameters_of_a_cell_are_written_anew_and_no_trial_is_lost(filled: Path, damage: str) -> None:
    campaign = resolve(CAMPAIGN, coins)
    with open_store(filled, is_writer=True) as store:
        before = list(store.trials())
    change(filled, f"UPDATE cells SET {damage} WHERE rowid = (SELECT max(cell) FROM cells)")

    with open_store(filled, is_writer=True) as store:
        with pytest.raises(InputError, match="run the campaign's command again to mend it"):
            list(store.trials())
        assert store.inventory(campaign.numbered_cells).count() == (12, 0)
        store.write_cells(campaign.numbered_cells)
        assert list(store.trials()) == before


def test_damage_that_makes_two_rows_of_one_trial_costs_one_of_them(filled: Path) -> None:
    change(filled, "DROP INDEX one_row_each")
    change(filled, "UPDATE trials SET seed = 1 WHERE rowid = (SELECT max(rowid) FROM trials WHERE seed = 2)")
    with open_store(filled, is_writer=True) as store:
        (row_id,) = store.inventory().damaged
        change(filled, "CREATE INDEX one_row_each ON trials (cell, seed)")
        store.forget([row_id])
        assert store.inventory().count() == (11, 0)
        assert len(list(store.trials())) == 11


@pytest.mark.parametrize(
    "statement",
    [
        "DELETE FROM campaign",
        "UPDATE campaign SET definition = '{'",
        "UPDATE campaign SET definition = '{}'",
        "DROP TABLE trials",
        "DROP TABLE campaign",
    ],
)
def test_a_store_that_lost_what_it_is_about_is_refused(filled: Path, statement: str) -> None:
    change(filled, statement)

    with (
        pytest.raises(InputError, match=r"campaign\.sqlite: .*damaged.* --fresh to start over"),
        open_store(filled, is_writer=True) as store,
    ):
        _ = list(store.trials())


def test_a_folder_in_the_stores_place_is_refused(tmp_path: Path) -> None:
    (tmp_path / "campaign.sqlite").mkdir()
    with pytest.raises(InputError, match=r"campaign\.sqlite: .* move it away, or give another -o"):
        open_or_create(tmp_path / "campaign.sqlite", definition())


def test_a_run_whose_origin_is_damaged_costs_no_trial(filled: Path) -> None:
    change(filled, "UPDATE runs SET provenance = '{'")

    with open_store(filled, is_writer=True) as store:
        (run,) = store.runs()
        assert run["damaged"] == "{"
        assert len(list(store.trials())) == 12


@pytest.mark.parametrize(("seed", "flips"), [(1, 100), pytest.param(2, 150, marks=pytest.mark.slow)])
def test_no_flipped_bit_is_more_than_one_line_and_none_costs_more_than_it_must(
    filled: Path, seed: int, flips: int
) -> None:
    sound = filled.read_bytes()
    chance = random.Random(seed)
    refusals: list[str] = []
    mended = 0
    for _ in range(flips):
        flipped = bytearray(sound)
        flipped[chance.randrange(len(sound))] ^= 1 << chance.randrange(8)
        filled.write_bytes(flipped)
        try:
            with open_or_create(filled, definition()) as store:
                store.write_cells(resolve(CAMPAIGN, coins).numbered_cells)
                damaged = store.inventory().damaged
                store.forget(damaged)
                mended += bool(damaged)
                assert (
                    len([trial for trial in store.trials() if trial.payload is None or trial.tables()]) >= 11
                )
        except InputError as error:
            refusals.append(str(error))
    assert mended > 0
    assert 0 < len(refusals) < flips / 2
    assert [refusal for refusal in refusals if "\n" in refusal] == []


def test_an_empty_file_is_taken_as_no_store_yet(tmp_path: Path) -> None:
    path = tmp_path / "campaign.sqlite"
    path.touch()
    with open_or_create(path, definition()) as store:
        assert statuses(store) == {}


def test_a_store_of_a_killed_process_is_kept_aside_with_its_journal(filled: Path) -> None:
    content = filled.read_bytes()
    journal = filled.with_name("campaign.sqlite-journal")
    journal.write_bytes(b"half a transaction")

    aside = back_up(filled)

    assert aside == filled.with_name("campaign.old-1.sqlite")
    assert aside.read_bytes() == content
    assert aside.with_name("campaign.old-1.sqlite-journal").read_bytes() == b"half a transaction"
    assert not filled.exists()
    assert not journal.exists()
    filled.touch()
    assert back_up(filled) == filled.with_name("campaign.old-2.sqlite")
    assert back_up(filled) is None


def test_readers_may_look_while_a_writer_is_at_it(filled: Path) -> None:
    with (
        only_writer(filled.parent),
        open_store(filled, is_writer=True) as writer,
        open_store(filled) as reader,
    ):
        run_id = writer.begin_run(collect(1))
        spec = next(iter(resolve(CAMPAIGN, coins).trials()))
        writer.record(run_id, spec, Outcome(spec.trial_id, 0.1, failure="no"))
        assert statuses(reader)[spec.trial_id] == "failed"


def test_a_folder_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with (
        pytest.raises(InputError, match=r"file.*cannot be used as a folder for results"),
        only_writer(tmp_path / "file"),
    ):
        pass
