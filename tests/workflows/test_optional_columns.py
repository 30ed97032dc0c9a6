"""Results from before a column that may be missing are read; what is run has to have it."""

import importlib
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

import midnet_bench as mb
from midnet_bench.campaign.definition import Definition, parse_campaign, resolve
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.runner import run_campaign
from midnet_bench.campaign.store import open_or_create
from midnet_bench.campaign.trial import Column, Columns, Outcome, TrialSpec, check_tables, encode_tables
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.experiments.columns import LABYRINTH
from midnet_bench.workflows.report import write_report
from midnet_bench.workflows.verify import compare_exactly
from tests.stores import labyrinth_result

TABLE, COLUMN = "intruders", "straight_m"


@pytest.fixture
def optional(monkeypatch: pytest.MonkeyPatch) -> None:
    """The column counts as new."""
    columns = LABYRINTH[TABLE].columns
    monkeypatch.setitem(columns, COLUMN, replace(columns[COLUMN], may_be_missing=True))  # type: ignore[arg-type]


def stored(folder: Path, lacking: tuple[int, ...]) -> Path:
    """A campaign's folder whose trials of the seeds ``lacking`` are from before the column."""
    folder.mkdir()
    grid = {"intruders": [1, 2], "robots": [1, 2]}
    store = open_or_create(folder / "campaign.sqlite", Definition("labyrinth", 1, 3, grid, {}))
    run_id = store.begin_run(collect(1))
    for intruders in (1, 2):
        for robots in (1, 2):
            for seed in (1, 2, 3):
                spec = TrialSpec("labyrinth", {"intruders": intruders, "robots": robots}, seed)
                result = labyrinth_result(intruders, robots, 1)
                for row in result.tables[TABLE] if seed in lacking else ():
                    del row[COLUMN]
                store.record(run_id, spec, Outcome(spec.trial_id, 6.0, 60.0, encode_tables(result)))
    store.close()
    return folder


@pytest.mark.usefixtures("optional")
@pytest.mark.parametrize("lacking", [(1, 2, 3), (1,), (3,)])
def test_a_store_without_it_is_reported_and_read_from_its_files(
    tmp_path: Path, lacking: tuple[int, ...]
) -> None:
    folder = stored(tmp_path / "run", lacking)
    write_report(folder)
    for _ in ("the store", "the files"):
        frame = mb.results(folder).tables[TABLE]
        assert (frame[COLUMN].isna() == frame["seed"].isin(lacking)).all()
        (folder / "campaign.sqlite").unlink(missing_ok=True)


@pytest.mark.slow
@pytest.mark.usefixtures("optional")
def test_a_store_without_it_goes_on_with_trials_that_have_it(tmp_path: Path) -> None:
    short = {"intruders": 1, "robots": 1, "engine": "fast", "time_limit_s": 1.0}
    written = {"experiment": "labyrinth", "parameters": short, "trials": 2}
    campaign = resolve(parse_campaign(written, "test"), registry)
    old, new = campaign.trials()
    result = labyrinth_result(1, 1, 1)
    del result.tables[TABLE][0][COLUMN]
    with open_or_create(tmp_path / "campaign.sqlite", campaign.definition_in(tmp_path)) as store:
        outcome = Outcome(old.trial_id, 6.0, 60.0, encode_tables(result))
        store.record(store.begin_run(collect(1)), old, outcome)

    assert run_campaign(campaign, tmp_path, jobs=1).ran == 1
    write_report(tmp_path)
    frame = mb.results(tmp_path).tables[TABLE].set_index("seed")
    assert frame[COLUMN].isna().to_dict() == {old.seed: True, new.seed: False}
    assert frame["detected_at_s"][old.seed] == 10.0


def test_a_store_without_a_column_that_has_to_be_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"column '{COLUMN}': missing"):
        write_report(stored(tmp_path / "run", (1,)))


def test_what_is_run_has_to_have_it() -> None:
    tables = {"one": Columns({"old": Column(int), "new": Column(int, may_be_missing=True, at_most="old")})}
    check_tables(tables, {"one": [{"old": 2}]}, {})
    check_tables(tables, {"one": [{"old": 2, "new": 1}]}, {}, is_new=True)
    with pytest.raises(ValueError, match="column 'new': missing"):
        check_tables(tables, {"one": [{"old": 2}]}, {}, is_new=True)
    with pytest.raises(ValueError, match="column 'old': missing"):
        check_tables(tables, {"one": [{"new": 2}]}, {})
    with pytest.raises(ValueError, match="more than old"):
        check_tables(tables, {"one": [{"old": 2, "new": 3}]}, {})


@pytest.mark.usefixtures("optional")
def test_exact_comparison_says_that_it_is_missing_and_compares_the_rest(tmp_path: Path) -> None:
    run = stored(tmp_path / "run", ())
    write_report(run)
    old = stored(tmp_path / "old", (1, 2, 3))
    write_report(old)
    said = "compared to the byte; not compared: intruders.csv: straight_m, which the {} lacks"
    assert compare_exactly(run, old) == ([], said.format("reference"))
    assert compare_exactly(old, run) == ([], said.format("run"))
    other = shutil.copytree(old, tmp_path / "other")
    path = other / f"{TABLE}.csv"
    path.write_text(path.read_text().replace(",caught,", ",escaped,", 1))
    (line,) = compare_exactly(run, other)[0]
    assert line == "run: intruders.csv: row 1: outcome caught, golden escaped"


def test_the_page_of_results_marks_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "docs")
    block = importlib.import_module("make_results").block
    table = Columns({"old": Column(int, "first"), "new": Column(int, "first", may_be_missing=True)}, "A row.")
    assert block("one", table) == (
        "**`one`** A row. Columns: `old`: first; `new`: first; not in results of earlier releases.\n"
    )
