"""The forms of a table: CSV and JSON for programs; Markdown, LaTeX and a terminal's cells for people."""

import csv
import json
import math
from pathlib import Path

import numpy as np

from midnet_bench.analysis.statistics import Estimate
from midnet_bench.analysis.tables import Table, to_json

ROWS = [
    {"trial": "1-robot", "tp": 6967, "precision": 0.97536, "share": math.nan},
    {"trial": "5-robot", "tp": 14953, "precision": 1.0, "note": "a_b & 5 %"},
]
ESTIMATE = Table(
    "rates",
    "Rates",
    [
        {"robots": 1, "rate": Estimate(0.5, 0.25, 0.75, 8)},
        {"robots": 2, "rate": Estimate(1.0, math.nan, math.nan, 1)},
    ],
)


def test_one_table_has_three_forms(tmp_path: Path) -> None:
    table = Table("scores", "Scores", ROWS, digits={"share": 1})
    written = table.write(tmp_path)

    assert [path.name for path in written] == ["scores.csv", "scores.md", "scores.tex"]
    lines = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in written[1].read_text().splitlines()
    ]
    assert lines[0] == ["trial", "tp", "precision", "share", "note"]
    assert [cell.endswith(":") for cell in lines[1]] == [False, True, True, True, False]
    assert lines[2:] == [
        ["1-robot", "6967", "0.975", "n/a", ""],
        ["5-robot", "14953", "1.000", "", "a_b & 5 %"],
    ]
    latex = written[2].read_text().splitlines()
    assert latex[0] == r"\begin{tabular}{lrrrl}"
    assert [line for line in latex if line.startswith("\\")][1:4] == [
        r"\toprule",
        r"\midrule",
        r"\bottomrule",
    ]
    assert r"a\_b \& 5 \%" in latex[5]


def test_latex_keeps_every_character_of_a_text() -> None:
    latex = Table("t", "", [{"text": "\\ ^ ~ { } $ # _ %"}]).to_latex()
    assert r"\textbackslash{} \^{} \textasciitilde{} \{ \} \$ \# \_ \%" in latex


def test_an_estimate_has_its_interval_in_every_form() -> None:
    rows = list(csv.DictReader(ESTIMATE.to_csv().splitlines()))
    assert rows[0] == {"robots": "1", "rate": "0.5", "rate_low": "0.25", "rate_high": "0.75", "rate_n": "8"}
    assert rows[1]["rate_low"] == ""
    assert ESTIMATE.cells() == [["1", "0.500 [0.250, 0.750]"], ["2", "1.000"]]
    assert "0.500 [0.250, 0.750]" in ESTIMATE.to_latex()
    assert "0.500 [0.250, 0.750]" in ESTIMATE.to_markdown()


def test_an_estimates_columns_can_have_names_of_their_own() -> None:
    table = Table("t", "", [{"ours": Estimate(1.0, 0.0, 2.0, 3)}], bounds={"ours": ("low", "high", "seeds")})
    assert table.to_csv() == "ours,low,high,seeds\n1.0,0.0,2.0,3\n"


def test_json_has_a_schema_stable_keys_and_null_for_what_is_not_defined() -> None:
    told = json.loads(json.dumps(to_json("coins", [ESTIMATE], files=["a"]), allow_nan=False))
    assert told == {
        "schema": 1,
        "experiment": "coins",
        "tables": {
            "rates": [
                {"robots": 1, "rate": {"value": 0.5, "low": 0.25, "high": 0.75, "n": 8}},
                {"robots": 2, "rate": {"value": 1.0, "low": None, "high": None, "n": 1}},
            ]
        },
        "files": ["a"],
    }


def test_the_csv_keeps_every_digit() -> None:
    third = 1 / 3
    rows = [{"x": third, "y": math.nan, "z": None}, {"x": np.float64(third), "y": np.int64(2), "z": np.True_}]
    first, second = csv.DictReader(Table("t", "", rows).to_csv().splitlines())

    assert float(first["x"]) == float(second["x"]) == third
    assert (first["y"], first["z"], second["y"], second["z"]) == ("", "", "2", "True")


def test_a_bar_in_a_cell_begins_no_other_one() -> None:
    lines = Table("t", "", [{"a|b": "c|d"}]).to_markdown().splitlines()
    assert [line.split() for line in lines[::2]] == [["|", "a\\|b", "|"], ["|", "c\\|d", "|"]]


def test_what_does_not_apply_is_blank() -> None:
    assert Table("t", "", [{"a": None, "b": math.nan}]).cells() == [["", "n/a"]]
