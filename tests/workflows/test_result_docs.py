"""``docs/results.md`` describes every column that real outputs have, and none that they have not."""

import re
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.analysis.statistics import Estimate
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.trial import TIMING_TABLE
from midnet_bench.experiments.columns import DETECTION, LABYRINTH, MAPPING
from midnet_bench.experiments.registry import experiment_of, tables_of
from midnet_bench.workflows.compare import compare, sweeps
from midnet_bench.workflows.verify import power_report, verify

REPOSITORY = Path(__file__).parents[2]
REFERENCES = REPOSITORY / "results" / "reference"
PAGE = (REPOSITORY / "docs" / "results.md").read_text(encoding="utf-8")
ONE_LINE_EACH = re.sub(r"(?<!\n)\n(?!\n)", " ", PAGE)  # the page with each paragraph on a line
TABLES = {**TIMING_TABLE, **MAPPING, **LABYRINTH, **DETECTION}
"""whose paragraphs are made from their declarations"""
OPTIONAL = {"variant", "role", "false_target_time"}  # columns that not every campaign has


def described(table: str) -> set[str]:
    """The columns in the table's paragraph: ``**`table`** ... Columns: `one`: ...; `two`: ...``."""
    if table in TABLES:  # made from their declarations
        return set(TABLES[table].columns)
    (section,) = re.findall(rf"^\*\*`{table}`\*\*.*? Columns: (.*?)$", ONE_LINE_EACH, flags=re.M)
    keys = [item.partition(": ")[0] for item in section.split("; ")]
    return {name for key in keys for name in re.findall(r"`([^`]+)`", key)}


def check(table: str, columns: Iterable[str], own_names: Iterable[str] = ()) -> None:
    """Fail unless ``columns`` are those that are described; ``own_names`` are what a user has named."""
    named = {name: "CAMPAIGN" for name in own_names}
    seen = {named.get(name, re.sub(r"^\d+ robots?", "N robots", name)) for name in columns}
    page = described(table)
    assert not seen - page, f"{table}: not described"
    assert not page - seen - OPTIONAL, f"{table}: described, but not there"


def check_table(table: Table, own_names: Iterable[str] = ()) -> None:
    written = {name for row in table.flat_rows() for name in row}
    parts = {
        part
        for row in table.rows
        for name, cell in row.items()
        if isinstance(cell, Estimate) and name not in table.bounds
        for part in (f"{name}_low", f"{name}_high", f"{name}_n")
    }
    check(table.name, written - parts, own_names)


@cache
def reference(name: str) -> Results:
    return load_results(REFERENCES / name, tables_of)


def check_campaign(results: Results) -> None:
    place = {*results.factors, "seed"}
    for name, frame in {**results.tables, "timing": results.timing}.items():
        if name in dict.fromkeys(re.findall(r"^\*\*`(\w+)`\*\*", PAGE, flags=re.M)):
            check(name, set(frame.columns) - place)
        else:
            pytest.fail(f"{name}.csv is not described")
    for table in experiment_of(results).report.tables(results):
        check_table(table)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["detection", "labyrinth", "pursuit", "mapping", "robustness"])
def test_every_column_of_a_reference_is_described(name: str) -> None:
    check_campaign(reference(name))


@pytest.mark.slow
def test_every_column_of_the_comparison_of_variants_is_described() -> None:
    ((table, _),) = sweeps(reference("robustness"))
    assert table.to_csv() == (REFERENCES / "robustness" / "differences_by_variant.csv").read_text(
        encoding="utf-8"
    )
    assert {name for row in table.flat_rows() for name in row} == described("differences_by_FACTOR") | {
        "variant"
    }


@pytest.mark.slow
def test_every_column_of_a_fresh_campaign_is_described(detection_campaign: Path) -> None:
    results = load_results(detection_campaign)
    assert set(results.tables) == {"scores", "frames", "robots"}
    check_campaign(results)


@pytest.mark.slow
def test_what_commands_print_is_described(tmp_path: Path) -> None:
    labyrinth = REFERENCES / "labyrinth"
    check_table(verify(labyrinth)[1])
    check_table(power_report(labyrinth, 5.0)[1])
    link = tmp_path / "again"
    link.symlink_to(labyrinth)
    tables = compare([labyrinth, link]).tables
    rates, differences, settings = tables
    check_table(rates)
    check_table(differences, ["labyrinth", "again"])
    assert settings.rows == []
    assert described("settings") == {"setting", "CAMPAIGN"}
