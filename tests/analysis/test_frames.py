"""A campaign's results as data frames: the same from its store and from the files that a report writes."""

import gzip
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.store import open_or_create
from midnet_bench.campaign.trial import Outcome, Row, Scalar, TrialResult, TrialSpec, encode_tables
from midnet_bench.errors import InputError
from midnet_bench.experiments.registry import tables_of
from midnet_bench.workflows.report import write_report
from tests.stores import detection_store, labyrinth_store

REFERENCES = Path(__file__).parents[2] / "results" / "reference"
COUNTS = ["tp", "fp", "fn", "intruders_in_range", "matched", "duplicates", "missed"]


def odd_store(folder: Path) -> None:
    """Values that a CSV file could change: types of factors, empty tables, booleans, long floats, texts."""
    grid: dict[str, list[Scalar]] = {
        "mode": ["1", "nan", '{"a": "x,y"}'],
        "size_m": [3.0, 0.1 + 0.2],
        "flag": [True, False],
    }
    with open_or_create(
        folder / "campaign.sqlite", Definition("detection", 1, 2, grid, {"robots": 1})
    ) as store:
        run_id = store.begin_run(collect(1))
        for mode in grid["mode"]:
            for size_m in grid["size_m"]:
                for flag in grid["flag"]:
                    cell: dict[str, Scalar] = {"mode": mode, "size_m": size_m, "flag": flag}
                    for seed in (1, 2):
                        row: Row = {"x": math.pi / seed, "n": seed, "ok": flag, "text": "NA", "none": None}
                        tables: dict[str, list[Row]] = {"rows": [row, {**row, "late": 1}], "empty": []}
                        spec = TrialSpec("detection", {"robots": 1, **cell}, seed)
                        if mode == "nan" and seed == 2:
                            store.record(
                                run_id, spec, Outcome(spec.trial_id, 1.0, failure="ValueError: no, not")
                            )
                        else:
                            payload = encode_tables(TrialResult(tables, 2.0))
                            store.record(run_id, spec, Outcome(spec.trial_id, 1 / 3, 2.0, payload))


@pytest.mark.parametrize(
    "kind", ["odd", *(pytest.param(name, marks=pytest.mark.slow) for name in ("detection", "labyrinth"))]
)
def test_store_and_files_give_the_same_data_frames(tmp_path: Path, kind: str) -> None:
    if kind == "detection":
        detection_store(
            tmp_path, {1: {3: (0.9, 0.5, math.nan), 4: (1 / 3, 0.1, 0.2)}, 5: {3: (0.1, 0.2, 0.3)}}
        )
    elif kind == "labyrinth":
        cells: dict[str, list[Scalar]] = {"intruders": [1, 2], "robots": [1, 2]}
        store = tmp_path / "campaign.sqlite"
        labyrinth_store(store, lambda k, q, seed: seed % k, seeds=3, grid=cells, failed=(2, 2, 2)).close()
    else:
        odd_store(tmp_path)
    stored = load_results(tmp_path)
    frames = dict(stored.tables)
    if kind == "odd":  # no such experiment: the files alone, and no tables of it
        from midnet_bench.campaign.store import export_csv, open_store

        with open_store(tmp_path / "campaign.sqlite") as store:
            export_csv(store, tmp_path)
        (tmp_path / "configuration.json").write_text(stored.definition.to_json())
    else:
        write_report(tmp_path, drawn_from=9)
    (tmp_path / "campaign.sqlite").unlink()
    check_same(load_results(tmp_path), stored, frames)
    for path in tmp_path.glob("*.csv"):
        path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    read = load_results(tmp_path)
    check_same(read, stored, frames)
    assert kind == "odd" or read.provenance == stored.provenance
    assert (len(read.failures) > 0) == (kind != "detection")


def check_same(read: Results, stored: Results, frames: dict[str, pd.DataFrame]) -> None:
    assert read.definition == stored.definition
    assert set(frames) - {"empty"} == set(read.tables)
    for name in read.tables:
        pd.testing.assert_frame_equal(read.tables[name], frames[name], check_exact=True)
    pd.testing.assert_frame_equal(read.timing, stored.timing, check_exact=True)
    pd.testing.assert_frame_equal(read.failures, stored.failures)
    assert read.finished == stored.finished > 0


def test_factors_keep_their_types_and_floats_their_digits(tmp_path: Path) -> None:
    odd_store(tmp_path)
    results = load_results(str(tmp_path))
    frame = results.table("rows")
    assert list(frame.columns[:4]) == ["mode", "size_m", "flag", "seed"]
    assert frame["mode"].unique().tolist() == ["1", "nan", '{"a": "x,y"}']
    assert frame["size_m"].unique().tolist() == [3.0, 0.1 + 0.2]
    assert frame["x"].iloc[0] == math.pi
    assert (frame["flag"].dtype, frame["ok"].dtype, frame["text"].iloc[0]) == (bool, bool, "NA")
    assert results.other_factors(frame, "mode", "size_m")[0] == "flag=True"
    assert results.column(frame, "robots").unique().tolist() == [1]
    assert "ValueError: no, not" in results.failures["reason"].tolist()


def test_the_frames_of_the_detection_reference_sum_to_its_scores() -> None:
    tables = load_results(REFERENCES / "detection", tables_of).tables
    cells = ["robots", "seed"]
    summed = tables["frames"].groupby(cells)[[*COUNTS, "error_sum_m"]].sum()
    scores = tables["scores"].set_index(cells)
    assert len(scores) == 40
    assert (tables["frames"].groupby(cells).size() == scores["frames"]).all()
    assert (summed[COUNTS] == scores[COUNTS]).all(axis=None)
    np.testing.assert_allclose(summed["error_sum_m"], scores["error_sum_m"], rtol=1e-12)


def test_the_labyrinth_reference_has_every_trial_and_eq_11_holds_in_each() -> None:
    results = load_results(REFERENCES / "labyrinth")
    tables = results.tables
    assert set(tables) == {"trial", "intruders", "robots"}
    assert str(results.provenance[0]["command"]).startswith("midnet-bench run labyrinth-report")
    place = ["intruders", "robots", "seed"]
    trials = tables["trial"].set_index(place)
    caught = (
        (tables["intruders"]["outcome"] == "caught")
        .groupby([tables["intruders"][key] for key in place])
        .sum()
    )
    assert results.finished == len(trials) == 500
    assert trials.groupby("robots").size().to_dict() == dict.fromkeys(range(1, 6), 100)
    assert (trials["caught"] == caught).all()
    numbers = trials.index.get_level_values("intruders")
    np.testing.assert_allclose(trials["success_rate"], 100.0 * trials["caught"] / numbers)


def test_what_is_no_campaign_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no campaign here"):
        load_results(tmp_path)
    (tmp_path / "configuration.json").write_text('{"map": "exact"}')
    with pytest.raises(InputError, match=r"configuration\.json: is not the configuration of a campaign"):
        load_results(tmp_path)


def test_a_damaged_or_missing_table_is_named(tmp_path: Path) -> None:
    detection_store(tmp_path, {1: {1: (0.9, 0.5, 0.6)}})
    write_report(tmp_path, drawn_from=9)
    (tmp_path / "campaign.sqlite").unlink()
    scores = tmp_path / "scores.csv"
    for content, says in (
        ("robots,seed,x\n7,1,2\n", "robots: '7' is no value of the grid"),
        ('robots,seed,x\n1,1,"2\n', "cannot be read"),
        (None, "missing"),
    ):
        scores.unlink() if content is None else scores.write_text(content)
        with pytest.raises(InputError, match=rf"scores\.csv: .*{says}"):
            load_results(tmp_path).table("scores")
