"""Tidy CSV files from a store alone: the same trials give the same bytes, whenever and wherever they ran."""

import contextlib
import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

from midnet_bench.campaign.columns import Column, Columns, Tables, check_tables, shown
from midnet_bench.campaign.payload import OTHER_FILES
from midnet_bench.campaign.store import Store
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.io.files import temporary_path

TIMING, FAILURES = OTHER_FILES
TIMING_TABLE: Tables = {
    TIMING: Columns(
        {
            "status": Column(str, choices=("finished", "failed")),
            "wall_s": Column(
                float,
                "wall time of the trial in its worker process; of trials that share a simulation, each an "
                "equal part",
                "s",
            ),
            "simulated_s": Column(
                float, "how long the trial lasted in its world; empty if it failed", "s", may_be_empty=True
            ),
            "finished_utc": Column(str, "when it was stored, ISO 8601"),
        },
        "One row per trial. Wall times differ from run to run, hence a file for them alone.",
        one_row=True,
    )
}


def export_csv(store: Store, directory: Path, expected: Tables = MappingProxyType({})) -> list[Path]:
    """Writes one CSV per table of the trials; the files written.

    Rows stand in the campaign's order (cells, then seeds, then the trial's own rows), led by the
    factors of the grid and the seed. ``timing.csv`` keeps wall times apart, because no two runs agree
    on them. ``failures.csv`` names the trials that failed; it is there only if some did. One trial is in
    memory at a time, however many there are.

    Args:
        store: open.
        directory: for the files.
        expected: the tables that the campaign's experiment has; any do if it declares none.

    Raises:
        InputError: a trial is damaged or its tables are others, or the folder cannot be written. No file is
            written then.
        MidnetBenchError: there is no room.
    """
    definition = store.definition
    with contextlib.ExitStack() as drafts:
        tables: dict[str, _Growing] = {}

        def table(name: str) -> "_Growing":
            if name not in tables:
                draft = drafts.enter_context(temporary_path(directory / f"{name}.csv"))
                tables[name] = drafts.enter_context(_Growing(draft))
            return tables[name]

        table(TIMING)
        for trial in store.trials():
            key: Row = {**definition.cell_of(trial.parameters), "seed": trial.seed}
            timing: Row = {name: getattr(trial, name) for name in TIMING_TABLE[TIMING].columns}
            try:
                check_tables(TIMING_TABLE, {TIMING: [timing]}, key)
            except ValueError as error:
                raise trial.fault(str(error), definition.grid) from error
            table(TIMING).add(key, [timing])
            if trial.traceback is not None:
                table(FAILURES).add(key, [{"trial_id": trial.trial_id, "reason": trial.reason}])
            else:
                for name, rows in trial.tables(expected, definition.grid).items():
                    for row in rows:
                        for column in row.keys() & key.keys():
                            if row[column] != key[column]:
                                what = f"table '{name}', column '{column}': {shown(row[column])} is another's"
                                raise trial.fault(what, definition.grid)
                    table(name).add(key, rows)
    if FAILURES not in tables:
        (directory / f"{FAILURES}.csv").unlink(missing_ok=True)
    return [directory / f"{name}.csv" for name in tables]


class _Growing:
    """A CSV file that is written row by row; a context manager. Its columns may become more on the way."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._columns: dict[str, None] = {}
        self._columns_of_header: tuple[str, ...] | None = None

    def add(self, key: Mapping[str, Scalar], rows: Iterable[Row]) -> None:
        """Rows behind what they all begin with."""
        for row in rows:
            values = {**key, **row}
            if tuple(values) != self._columns_of_header:
                self._columns |= dict.fromkeys(values)
                if self._columns_of_header is None:
                    self._columns_of_header = tuple(values)
                    self._writer.writerow(values)
                values = {column: values.get(column) for column in self._columns}
            # the writer leaves None empty, and writes floats as repr does
            self._writer.writerow([None if value != value else value for value in values.values()])

    def __enter__(self) -> "_Growing":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        with self._file:
            if kind is None and not self._columns:
                self._writer.writerow([])
        if kind is None and len(self._columns) > len(self._columns_of_header or ()):
            self._widen()

    def _widen(self) -> None:
        """Writes the file anew under all columns; rows that came before a column have an empty cell in it."""
        with self._path.open(encoding="utf-8", newline="") as file:
            _, *lines = csv.reader(file)
        with self._path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(self._columns)
            writer.writerows(line + [""] * (len(self._columns) - len(line)) for line in lines)


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
