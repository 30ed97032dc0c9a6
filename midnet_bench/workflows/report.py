"""What is made of a campaign's results: CSV files, tables, figures, and a page with all of them."""

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from midnet_bench import __version__
from midnet_bench.analysis.claims import is_decided, verdict_table
from midnet_bench.analysis.frames import CONFIGURATION, PROVENANCE, Results, load_results, results_of
from midnet_bench.analysis.tables import Table, write_tables
from midnet_bench.campaign.store import FILE_NAME, open_store
from midnet_bench.errors import InputError
from midnet_bench.experiments.registry import (
    Experiment,
    Headline,
    columns_of,
    experiment_in,
    experiment_of,
    tables_of,
)
from midnet_bench.io.files import plain_name, write_atomically
from midnet_bench.workflows.compare import Comparison, sweep, sweeps
from midnet_bench.workflows.verify import packaged_reference, summarized

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from midnet_bench.page.page import Picture

FORMATS = ("png", "svg")  # of figures, unless others are given
PAGE = "report.html"
RECORDED = "recorded"  # the table of trials that were recorded
COUNTERFACTUALS = "counterfactuals"  # the table with a separate chapter


class Report(NamedTuple):
    """What was made of a campaign."""

    results: Results
    tables: list[Table]  # every table of the experiment
    printed: list[Table]  # those that a terminal shows, in the order of ``Experiment.printed``
    headline: Headline | None
    """what a terminal shows first, beside the packaged reference; None: ``printed``"""


def write_report(
    directory: str | Path,
    drawn_from: int = 1,
    formats: Sequence[str] = FORMATS,
    before_drawing: Callable[[Report], None] = lambda report: None,
) -> Report:
    """Write CSV files, tables, figures, verdicts, configuration, provenance and ``report.html``.

    All of them go into the campaign's folder.
    Without a store the tables and figures are made of the CSV files that are there.

    Args:
        directory: of the campaign.
        drawn_from: how many trials have to be finished for figures to be drawn.
        formats: of figures: png, svg, pdf.
        before_drawing: called with the report when its tables are written, before figures and the page are.

    Raises:
        InputError: there is no campaign, or it is damaged, foreign or of a newer version.
    """
    directory = Path(directory)
    if (directory / FILE_NAME).exists():
        with open_store(directory / FILE_NAME) as store:
            record = experiment_in(store.definition, directory)
            results = results_of(store, directory, directory, partial(columns_of, record))
            configuration = json.loads(store.definition.to_json())
            for name, content in {CONFIGURATION: configuration, PROVENANCE: results.provenance}.items():
                write_atomically(directory / name, json.dumps(content, indent=1) + "\n")
    else:
        results = load_results(directory, tables_of)
        record = experiment_of(results)
    tables = list(record.report.tables(results))
    found = record.report.claims(results)
    claims = verdict_table(found) if found else None
    write_tables([*tables, claims] if claims else tables, directory)
    names = record.report.printed
    printed = [table for table in tables if not names or table.name in names]
    printed.sort(key=lambda table: names.index(table.name) if names else 0)
    report = Report(results, tables, printed, _headline(record, results) if results.finished else None)
    before_drawing(report)
    pictures: list[Picture] = []
    if results.finished >= drawn_from:
        pictures, swept = _drawn(record.report.figures(results), formats), _swept(sweeps(results), formats)
        _write(directory, pictures, swept)
        pictures += swept
    if results.finished:
        _write_page(report, record, claims, pictures)
    return report


def _write_page(
    report: Report, record: Experiment, claims: Table | None, pictures: "Sequence[Picture]"
) -> None:
    from midnet_bench.page.page import Content, report_page

    results, tables, headline, conclusion = report
    definition = results.definition
    grid = "".join(f"; {name}: {', '.join(map(str, values))}" for name, values in definition.grid.items())
    first, last = definition.base_seed, definition.base_seed + definition.trials - 1
    seeds = f"seed {first}" if first == last else f"seeds {first} to {last}"
    trials = f"{results.finished} finished trial{'s' * (results.finished != 1)}"
    undecided = [claims] if claims and not is_decided(claims) else []  # a sentence says so, at the top
    content = Content(
        title=f"{record.name.capitalize()} test",
        lead=f"{record.summary} {trials}; {seeds}{grid}.",
        conclusion=" ".join(conclusion.conclusion) if conclusion else "",
        headline=[table for table in headline if table.name != COUNTERFACTUALS],
        verdicts=summarized(claims, record, results) if claims else "",
        claims=None if claims in undecided else claims,
        counterfactuals=next((table for table in tables if table.name == COUNTERFACTUALS), None),
        tables=[
            table
            for table in (*tables, *undecided)
            if table not in headline and table.name != COUNTERFACTUALS
        ],
        pictures=pictures,
        provenance=results.provenance,
        configuration=json.loads(definition.to_json()),
        version=__version__,
    )
    # what plays trials knows arenas and robots, which take a second to import
    recordings = record.report.recordings(results) if RECORDED in results.tables else ()
    write_atomically(results.directory / PAGE, report_page(content, recordings))


def _headline(record: Experiment, results: Results) -> Headline | None:
    if record.report.headline is None:
        return None
    return record.report.headline(results, packaged_reference(record, results))


def plot(
    directory: str | Path,
    output: str | Path | None = None,
    x: str | None = None,
    y: str | None = None,
    formats: Sequence[str] | None = None,
) -> list[Path]:
    """Draw a campaign's figures anew, from its results alone; the files written.

    Args:
        directory: of the campaign.
        output: a folder for the figures, or a .pdf, .png or .svg file for the only one; the campaign's folder
            unless given.
        x: a numeric factor of the grid, for a figure of scores over it; see :func:`compare.sweep`.
        y: the score.
        formats: of the figures: png, svg, pdf; ``FORMATS`` unless given.

    Raises:
        InputError: there is no campaign, it is damaged, its experiment has no figures, there is no such
            format, or ``x`` and ``y`` are none.
    """
    target, wanted = Path(output or directory), FORMATS if formats is None else tuple(formats)
    if output is not None and target.suffix in (".pdf", ".png", ".svg"):
        ending = (target.suffix.removeprefix("."),)
        if wanted not in (FORMATS, ending):
            raise InputError(f"-o {output}: --format {','.join(wanted)} is another format; leave it out")
        with tempfile.TemporaryDirectory() as place:
            drawn = [one for one in plot(directory, place, x, y, ending) if one.suffix == target.suffix]
            if len(drawn) > 1:
                raise InputError(f"-o {output}: {len(drawn)} figures do not go into one file; give a folder")
            write_atomically(target, drawn[0].read_bytes())
        return [target]
    if y is not None and x is None:
        raise InputError(f"plot: --y {y}: say by --x over which factor of the grid")
    results = load_results(directory, tables_of)
    if x is not None:
        return _write(target, [], _swept([sweep(results, x, y)], wanted))
    figures = _drawn(experiment_of(results).report.figures(results), wanted)
    written = _write(target, figures, _swept(sweeps(results), wanted))
    if not written:
        raise InputError(
            f"{directory}: no figures: a campaign of '{results.definition.experiment}'"
            f" with {results.finished} finished trials; --x draws scores over a factor of its grid"
        )
    return written


def write_comparison(found: Comparison, output: Path) -> None:
    """Write a comparison's tables, and the figures that its campaigns have in common."""
    write_tables(found.tables, output)
    _write(output, _drawn(found.experiment.report.comparison_figures(found.campaigns), FORMATS))


def _drawn(figures: "Mapping[str, Figure]", formats: Sequence[str]) -> "list[Picture]":
    if not figures:
        return []
    from midnet_bench.drawing.charts import chart_files, drawn_data
    from midnet_bench.page.page import Picture

    return [Picture(stem, chart_files(one, formats), drawn_data(stem, one)) for stem, one in figures.items()]


def _swept(drawn: "Sequence[tuple[Table, Figure]]", formats: Sequence[str]) -> "list[Picture]":
    """Pictures with the tables that they show, whose numbers are written beside them."""
    return [
        picture._replace(data=table)
        for table, figure in drawn
        for picture in _drawn({plain_name(table.name): figure}, formats)
    ]


def _write(directory: Path, pictures: "Sequence[Picture]", swept: "Sequence[Picture]" = ()) -> list[Path]:
    """The files written: figures, and those of ``swept`` with their numbers beside them."""
    written = []
    for index, picture in enumerate([*pictures, *swept]):
        for ending, content in picture.files.items():
            write_atomically(directory / f"{picture.name}{ending}", content)
            written.append(directory / f"{picture.name}{ending}")
        if index >= len(pictures):
            written += picture.data.write(directory, picture.name)
    return written
