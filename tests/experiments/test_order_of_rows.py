"""Tables of the committed reference results: the same bytes in whatever order the trials' rows are."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import pandas as pd
import pytest

from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.analysis.tables import Table
from midnet_bench.experiments.detection import tables as detection
from midnet_bench.experiments.labyrinth import tables as labyrinth
from midnet_bench.experiments.labyrinth.tables import Variant, variants_of
from midnet_bench.experiments.mapping import tables as mapping

REFERENCE = Path(__file__).parents[2] / "results" / "reference"


@cache
def reference(name: str) -> Results:
    return load_results(REFERENCE / name)


def made(seed: int | None) -> dict[str, str]:
    """The tables by name, as CSV; of shuffled rows if there is a seed."""

    def rows(frame: pd.DataFrame) -> pd.DataFrame:
        return frame if seed is None else frame.sample(frac=1.0, random_state=seed)

    variants = {
        name: Variant(one.factors, rows(one.trials), rows(one.robots))
        for name, one in variants_of(reference("labyrinth")).items()
    }
    cells = {
        name: replace(cell, rows=rows(cell.rows))
        for name, cell in detection.cells_of(reference("detection")).items()
    }
    maps, robots = (
        {team: rows(own) for team, own in mapping.teams_of(reference("mapping"), table).items()}
        for table in ("maps", "robots")
    )
    tables: list[Table] = [
        *(make(variants) for make in (labyrinth.cells_table, labyrinth.health_table, labyrinth.speed_table)),
        labyrinth.success_table(variants),
        *detection.own_tables(cells),
        *(make(maps) for make in (mapping.teams_table, mapping.walls_table, mapping.measures_table)),
        mapping.speedup_table(maps),
        mapping.health_table(robots),
    ]
    return {table.name: table.to_csv() for table in tables}


@pytest.mark.slow
def test_tables_are_the_same_to_the_byte_in_any_order_of_rows() -> None:
    in_order, shuffled = made(None), made(1)
    assert [name for name in in_order if shuffled[name] != in_order[name]] == []
