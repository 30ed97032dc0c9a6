"""Tidy CSV files from a store alone: the same trials give the same bytes, whenever and wherever they ran."""

import csv
import io
from collections.abc import Iterable
from pathlib import Path

from midnet_bench.campaign.store import Store
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.io.files import write_atomically

TIMING = "timing"
FAILURES = "failures"


def export_csv(store: Store, directory: Path) -> list[Path]:
    """Writes one CSV per table of the trials; the files written.

    Rows stand in the campaign's order (cells, then seeds, then the trial's own rows), led by the
    factors of the grid and the seed. ``timing.csv`` keeps wall times apart, because no two runs agree
    on them. ``failures.csv`` names the trials that failed; it is there only if some did.
    """
    tables = tables_of(store)
    written = []
    for name, rows in tables.items():
        written.append(directory / f"{name}.csv")
        write_atomically(written[-1], csv_text(rows))
    if FAILURES not in tables:
        (directory / f"{FAILURES}.csv").unlink(missing_ok=True)
    return written


def tables_of(store: Store) -> dict[str, list[Row]]:
    """The rows of all trials by table, as :func:`export_csv` writes them.

    Raises:
        InputError: a trial is damaged.
    """
    definition = store.definition
    tables: dict[str, list[Row]] = {TIMING: []}
    for trial in store.trials():
        place: Row = {**definition.cell_of(trial.parameters), "seed": trial.seed}
        tables[TIMING].append(
            {
                **place,
                "status": trial.status,
                "wall_s": trial.wall_s,
                "simulated_s": trial.simulated_s,
                "finished_utc": trial.finished_utc,
            }
        )
        if trial.traceback is not None:
            reason = trial.traceback.splitlines()[-1]
            tables.setdefault(FAILURES, []).append({**place, "trial_id": trial.trial_id, "reason": reason})
        else:
            for name, rows in trial.tables.items():
                tables.setdefault(name, []).extend({**place, **row} for row in rows)
    return tables


def csv_text(rows: Iterable[Row]) -> str:
    """``rows`` as CSV under the columns in order of first appearance; NaN and None are empty cells.

    Floats are written as ``repr`` does, the shortest text that reads back as the same number.
    """
    rows = list(rows)
    columns = list(dict.fromkeys(column for row in rows for column in row))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([cell_text(row.get(column)) for column in columns] for row in rows)
    return text.getvalue()


def cell_text(value: Scalar) -> str:
    """A value as :func:`csv_text` writes it, without quotes."""
    if value is None or value != value:
        return ""
    return repr(value) if isinstance(value, float) else str(value)
