"""What is made of a campaign's results: CSV files, tables, figures."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from midnet_bench.analysis.claims import verdict_table
from midnet_bench.analysis.frames import CONFIGURATION, PROVENANCE, Results, load_results, results_of
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.store import FILE_NAME, open_store
from midnet_bench.errors import InputError
from midnet_bench.experiments.registry import experiment_of, tables_of
from midnet_bench.io.files import plain_name, write_atomically
from midnet_bench.workflows.sweeps import sweep, sweeps

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_report(directory: str | Path, drawn_from: int = 1) -> tuple[Results, list[Table]]:
    """Write CSV files, tables, figures, verdicts, configuration and provenance into a campaign's folder.

    Without a store the tables and figures are made of the CSV files that are there.

    Args:
        directory: of the campaign.
        drawn_from: how many trials have to be finished for figures to be drawn.

    Returns:
        The results, and every table of the experiment; :func:`printed` are those for a terminal.

    Raises:
        InputError: there is no campaign, or it is damaged, foreign or of a newer version.
    """
    directory = Path(directory)
    if (directory / FILE_NAME).exists():
        with open_store(directory / FILE_NAME) as store:
            results = results_of(store, directory, directory, tables_of)
            _write_json(directory / CONFIGURATION, json.loads(store.definition.to_json()))
            _write_json(directory / PROVENANCE, results.provenance)
    else:
        results = load_results(directory, tables_of)
    record = experiment_of(results)
    tables = list(record.tables(results))
    found = record.claims(results)
    for table in [*tables, verdict_table(found)] if found else tables:
        table.write(directory)
    if results.finished >= drawn_from:
        _write_figures(record.figures(results), directory)
        _write_sweeps(sweeps(results), directory)
    return results, tables


def printed(results: Results, tables: list[Table]) -> list[Table]:
    """Those of an experiment's tables that a terminal shows."""
    record = experiment_of(results)
    return [table for table in tables if not record.printed or table.name in record.printed]


def plot(
    directory: str | Path, output: str | Path | None = None, x: str | None = None, y: str | None = None
) -> list[Path]:
    """Draw a campaign's figures anew, from its results alone; the files written.

    Args:
        directory: of the campaign.
        output: a folder for the figures; the campaign's own unless given.
        x: a numeric factor of the grid, for a figure of scores over it; see :func:`sweeps.sweep`.
        y: the score.

    Raises:
        InputError: there is no campaign, it is damaged, its experiment has no figures, or ``x`` and ``y``
            are none.
    """
    if y is not None and x is None:
        raise InputError(f"plot: --y {y}: say by --x over which factor of the grid")
    results = load_results(directory, tables_of)
    folder = Path(output or directory)
    if x is not None:
        return _write_sweeps([sweep(results, x, y)], folder)
    written = _write_figures(experiment_of(results).figures(results), folder)
    written += _write_sweeps(sweeps(results), folder)
    if not written:
        raise InputError(
            f"{directory}: no figures: a campaign of '{results.definition.experiment}'"
            f" with {results.finished} finished trials; --x draws scores over a factor of its grid"
        )
    return written


def _write_sweeps(drawn: "Sequence[tuple[Table, Figure]]", directory: Path) -> list[Path]:
    """Figures with their numbers beside them; the files written."""
    written = []
    for table, figure in drawn:
        written += _write_figures({plain_name(table.name): figure}, directory)
        written += table.write(directory, plain_name(table.name))
    return written


def write_figures_of(results: Mapping[str, Results], output: Path) -> list[Path]:
    """Draw the figures that several campaigns of one experiment have in common; the files written."""
    record = experiment_of(next(iter(results.values())))
    return _write_figures(record.comparison_figures(results), output)


def _write_figures(figures: "Mapping[str, Figure]", directory: Path) -> list[Path]:
    if not figures:
        return []
    from midnet_bench.drawing.charts import chart_files

    written = []
    for stem, figure in figures.items():
        for ending, content in chart_files(figure).items():
            written.append(directory / f"{stem}{ending}")
            write_atomically(written[-1], content)
    return written


def _write_json(path: Path, content: object) -> None:
    write_atomically(path, json.dumps(content, indent=1) + "\n")
