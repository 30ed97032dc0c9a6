"""Numbers checked: the paper's claims against a campaign, and a campaign's against committed ones."""

import csv
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from midnet_bench.analysis.claims import Verdict, is_decided, judged, summary, verdict_table
from midnet_bench.analysis.frames import CONFIGURATION, Results, load_results
from midnet_bench.analysis.sample_size import POWER
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.provenance import Provenance, collect
from midnet_bench.campaign.trial import ANY_DRIFT, Drift
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.io.files import installed, shipped_folder, write_atomically

EXIT_CODES = {Verdict.INCONCLUSIVE: 3, Verdict.OUTSIDE: 4, Verdict.DOES_NOT_HOLD: 4}  # of others 0
REFERENCE = "results/reference"  # where a checkout has the results that the package reports
TABLES = {"smoke-detection": ("scores", "robots"), "smoke-labyrinth": ("trial", "intruders", "robots")}
"""packaged campaign -> its tables that have committed numbers"""
PLATFORM = "platform.json"
SAME_PLATFORM = ("libm", "machine", "processor", "python", "libraries")


class Verified(NamedTuple):
    """What the paper states, judged by a campaign."""

    experiment: str
    table: Table  # a row for each claim that the campaign bears on
    code: int
    """0 if all hold or lie within the range of our runs, 4 if one does not, else 3: some are inconclusive"""
    summary: str  # how many claims have which verdict; of too few seeds, what the packaged reference has


def verify(directory: str | Path) -> Verified:
    """Each of the paper's claims that the campaign in ``directory`` bears on, judged.

    Raises:
        InputError: a campaign that the paper states nothing about, or without the trials it takes.
    """
    results = load_results(directory, registry.tables_of)
    record = registry.experiment_of(results)
    found = record.report.claims(results)
    if not found:
        raise InputError(f"{directory}: nothing here that the paper states a result for")
    table, code = verdict_table(found), max(EXIT_CODES.get(each.verdict, 0) for each in judged(found))
    return Verified(results.definition.experiment, table, code, summarized(table, record, results))


def summarized(table: Table, record: registry.Experiment, results: Results) -> str:
    """How many claims of a campaign have which verdict; of too few seeds, what the packaged reference has."""
    if is_decided(table):
        return summary(table)
    trials = results.definition.trials
    few = {1: "One seed decides", 2: "Two seeds decide"}.get(trials, "These trials decide")
    sentence = f"{few} nothing of the paper's {len(table.rows)} claims; --seeds 20 may."
    reference = packaged_reference(record, results)
    if reference is None:
        return sentence
    first = reference.definition.base_seed
    last = first + reference.definition.trials - 1
    known = summary(verdict_table(record.report.claims(reference)))
    return f"{sentence} The packaged reference, seeds {first} to {last}: {known[0].lower()}{known[1:]}"


def packaged_reference(record: registry.Experiment, results: Results) -> Results | None:
    """The results of the same experiment that the package reports; None if these are they."""
    folder = shipped_folder(f"reference/{record.name}", f"{REFERENCE}/{record.name}")
    is_there = (folder / CONFIGURATION).is_file() and folder.resolve() != results.directory.resolve()
    return load_results(folder, lambda *_: record.columns) if is_there else None


def power_report(
    directory: str | Path, difference: float, robots: tuple[int, int] = (4, 5), power: float = POWER
) -> tuple[str, Table]:
    """The experiment, and how many trials a change of the main score needs to be detected.

    Args:
        directory: of a campaign whose experiment can tell; of this package's, a labyrinth campaign.
        difference: in percentage points.
        robots: the two team sizes that are compared.
        power: the probability of finding the difference if it is there.

    Raises:
        InputError: another experiment, a team size that the campaign lacks, or numbers out of range.
    """
    if not 0.0 < abs(difference) <= 100.0:
        raise InputError(f"--difference {difference:g}: expected percentage points, from above 0 to 100")
    if not 0.0 < power < 1.0:
        raise InputError(f"--power {power:g}: expected a probability between 0 and 1")
    if robots[0] == robots[1]:
        raise InputError(f"--robots {robots[0]} {robots[1]}: give two different team sizes")
    results = load_results(directory, registry.tables_of)
    record = registry.experiment_of(results)
    if record.report.power is None:
        raise InputError(f"{directory}: a {record.name} campaign; --difference works on labyrinth campaigns")
    if results.definition.trials < 2:
        raise InputError(
            f"{directory}: one trial per cell shows no spread; --difference needs 2, so --seeds 2"
        )
    return results.definition.experiment, record.report.power(results, abs(difference), robots, power)


def compare_exactly(run: Path, golden: Path | None = None, *, update: bool = False) -> tuple[list[str], str]:
    """What is off between a campaign's numbers and expected ones, a line each; and how it was judged.

    Args:
        run: the campaign's folder.
        golden: a folder of expected numbers, or of another campaign; the committed numbers of the packaged
            campaign that ``run`` is called by unless given.
        update: make the campaign's numbers the committed ones instead.

    Raises:
        InputError: there are no such numbers, or an installed package is to be changed.
    """
    name = run.resolve().name
    if golden is None:
        if name not in TABLES:
            raise InputError(
                f"{run}: no numbers are committed for a campaign of this name; give their folder, or run "
                f"{' or '.join(TABLES)}"
            )
        golden = shipped_folder(f"golden/{name}", f"results/reference/smoke/{name}")
    if update and installed():
        raise InputError("compare: --update changes the repository's numbers; run it in a checkout")
    found = sorted(path.stem for path in golden.glob("*.csv") if path.stem != "timing")  # wall times
    tables = TABLES.get(name) or tuple(found)
    if update:
        update_golden(run, golden, tables)
        return [], ""
    if (run / "failures.csv").exists() and (failures := _rows(run, "failures")):
        return [f"{name}: {len(failures)} trials failed"], "and no number was compared"
    is_exact, off = differences_from_golden(run, golden, tables)
    how = "compared to the byte" if is_exact else "within another platform's bounds"
    if missing := [line for table in tables for line in _not_compared(run, golden, table)]:
        how += f"; not compared: {', '.join(missing)}"
    return [f"{name}: {line}" for line in off], how


def update_golden(run: Path, golden: Path, tables: tuple[str, ...]) -> None:
    """Make the numbers of ``run`` the golden ones, with its platform. Raises InputError: one is not there."""
    try:
        numbers = {f"{name}.csv": (run / f"{name}.csv").read_bytes() for name in tables}
    except OSError as error:
        raise InputError(f"{error.filename}: {error.strerror}; make it by 'midnet-bench report'") from error
    for name, content in numbers.items():
        write_atomically(golden / name, content)
    write_atomically(golden / PLATFORM, json.dumps(_platform(), indent=1) + "\n")


def differences_from_golden(run: Path, golden: Path, tables: tuple[str, ...]) -> tuple[bool, list[str]]:
    """Whether every byte counts, and a line for each number of ``run`` that is off.

    Every byte counts on the platform of the golden numbers, and in another campaign's folder.

    Raises:
        InputError: there are no golden numbers.
    """
    is_campaign = any((golden / name).exists() for name in ("campaign.sqlite", "configuration.json"))
    try:
        is_exact = is_campaign or json.loads((golden / PLATFORM).read_text()) == _platform()
    except (OSError, ValueError) as error:
        raise InputError(f"{golden / PLATFORM}: no golden numbers here; make them with --update") from error
    drifts = {
        (table, column): known.drift
        for experiment in registry.names()
        for table, its in registry.experiment(experiment).columns.items()
        for column, known in its.columns.items()
    }
    return is_exact, [line for name in tables for line in _off(run, golden, name, {} if is_exact else drifts)]


def _platform() -> Provenance:
    here = collect(0)
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    # numerical libraries choose their code by what the processor can do
    digest = hashlib.sha256(flags.encode()).hexdigest()[:16] if lines else ""
    return {key: here[key] for key in SAME_PLATFORM} | {"processor_flags": digest}


def _off(run: Path, golden: Path, name: str, drifts: dict[tuple[str, str], Drift | None]) -> Iterator[str]:
    ours, theirs, may_lack = _rows(run, name), _rows(golden, name), _missing(name)
    if len(ours) != len(theirs):
        yield f"{name}.csv: {len(ours)} rows, golden {len(theirs)}"
    for number, (row, expected) in enumerate(zip(ours, theirs, strict=False), 1):
        for column in expected:
            if column not in row and column in may_lack:
                continue
            if not _agree(row.get(column, ""), expected[column], drifts.get((name, column))):
                yield f"{name}.csv: row {number}: {column} {row.get(column)}, golden {expected[column]}"


def _missing(name: str) -> set[str]:
    """The columns of a table that results may lack, of any experiment."""
    tables = [registry.experiment(one).columns.get(name) for one in registry.names()]
    return {column for its in tables if its for column, one in its.columns.items() if one.may_be_missing}


def _not_compared(run: Path, golden: Path, name: str) -> list[str]:
    """In words, the columns that one of two tables lacks, as it may."""
    ours, theirs = ({column for row in _rows(folder, name)[:1] for column in row} for folder in (run, golden))
    return [
        f"{name}.csv: {column}, which {'the run' if column in theirs else 'the reference'} lacks"
        for column in sorted((ours ^ theirs) & _missing(name))
    ]


def _agree(ours: str, golden: str, drift: Drift | None) -> bool:
    """``drift``: how far apart they may be; None if not at all."""
    if drift is None or drift == ANY_DRIFT or not (ours and golden):
        return drift == ANY_DRIFT or ours == golden
    return abs(float(ours) - float(golden)) <= drift.absolute + drift.share * abs(float(golden))


def _rows(folder: Path, name: str) -> list[dict[str, str]]:
    path = folder / f"{name}.csv"
    try:
        with path.open(newline="") as file:
            return list(csv.DictReader(file))
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such table; make it with 'midnet-bench report {folder}'") from error
