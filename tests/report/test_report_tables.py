import csv
import math
from pathlib import Path

from midnet_bench.analysis.tables import Table

ROWS = [
    {"trial": "1-robot", "tp": 6967, "precision": 0.97536, "share": math.nan},
    {"trial": "5-robot", "tp": 14953, "precision": 1.0, "note": "a_b & 5 %"},
]


def test_one_table_has_three_forms(tmp_path: Path) -> None:
    table = Table("Scores", ROWS, digits={"share": 1})
    written = table.write(tmp_path / "scores")

    assert [path.name for path in written] == ["scores.csv", "scores.md", "scores.tex"]
    assert written[1].read_text() == (
        "| trial | tp | precision | share | note |\n"
        "| --- | ---: | ---: | ---: | --- |\n"
        "| 1-robot | 6967 | 0.975 | n/a |  |\n"
        "| 5-robot | 14953 | 1.000 |  | a_b & 5 % |\n"
    )
    latex = written[2].read_text().splitlines()
    assert latex[0] == r"\begin{tabular}{lrrrr}"
    assert latex[2] == r"trial & tp & precision & share & note \\"
    assert r"5-robot & 14953 & 1.000 &  & a\_b \& 5 \% \\" in latex


def test_the_csv_keeps_every_digit(tmp_path: Path) -> None:
    third = 1 / 3
    (row,) = csv.DictReader(Table("", [{"x": third, "y": math.nan, "z": None}]).to_csv().splitlines())

    assert float(row["x"]) == third
    assert (row["y"], row["z"]) == ("", "")


def test_a_bar_in_a_cell_begins_no_other_one() -> None:
    assert Table("", [{"a|b": "c|d"}]).to_markdown().splitlines()[::2] == ["| a\\|b |", "| c\\|d |"]
