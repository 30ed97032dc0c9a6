"""A small run against committed numbers: to the byte on the platform that made them, else within bounds."""

import csv
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

from midnet_bench.campaign.columns import ANY_DRIFT, Drift
from midnet_bench.campaign.provenance import Provenance, collect
from midnet_bench.errors import InputError
from midnet_bench.experiments.registry import columns, names
from midnet_bench.io.files import write_atomically
from midnet_bench.workflows.shipped import installed, shipped_folder

TABLES = {
    "smoke-detection": ("scores", "robots"),
    "smoke-labyrinth": ("trial", "intruders", "robots"),
}
"""packaged campaign -> its tables that have committed numbers"""
PLATFORM = "platform.json"
SAME_PLATFORM = ("libm", "machine", "processor", "python", "libraries")


def compare_exactly(run: Path, golden: Path | None = None, *, update: bool = False) -> tuple[list[str], str]:
    """What is off between a campaign's numbers and the committed ones, a line each; and how it was judged.

    Args:
        run: the campaign's folder.
        golden: the committed numbers; those of the packaged campaign that the folder is called by unless
            given.
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
    committed = tuple(sorted(path.stem for path in golden.glob("*.csv")))
    tables = TABLES.get(name, committed)
    if update:
        update_golden(run, golden, tables)
        return [], ""
    if failures := _rows(run / "failures.csv") if (run / "failures.csv").exists() else []:
        return [f"{name}: {len(failures)} trials failed"], "and no number was compared"
    same_platform, off = differences_from_golden(run, golden, tables)
    how = "compared to the byte" if same_platform else "within another platform's bounds"
    return [f"{name}: {line}" for line in off], how


def update_golden(run: Path, golden: Path, tables: tuple[str, ...]) -> None:
    """Make the numbers of ``run`` the golden ones, with the platform that made them."""
    for name in tables:
        write_atomically(golden / f"{name}.csv", (run / f"{name}.csv").read_bytes())
    write_atomically(golden / PLATFORM, json.dumps(_platform(), indent=1) + "\n")


def differences_from_golden(run: Path, golden: Path, tables: tuple[str, ...]) -> tuple[bool, list[str]]:
    """Whether this is the golden numbers' platform, and a line for each number of ``run`` that is off.

    Raises:
        InputError: there are no golden numbers.
    """
    try:
        same_platform = json.loads((golden / PLATFORM).read_text()) == _platform()
    except (OSError, ValueError) as error:
        raise InputError(f"{golden / PLATFORM}: no golden numbers here; make them with --update") from error
    return same_platform, [line for name in tables for line in _differences(run, golden, name, same_platform)]


def _platform() -> Provenance:
    here = collect(0)
    return {key: here[key] for key in SAME_PLATFORM} | {"processor_flags": _processor_flags()}


def _processor_flags() -> str:
    """A digest of what the processor can do: numerical libraries choose their code by it; empty off Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return ""
    flags = next((line for line in lines if line.startswith(("flags", "Features"))), "")
    return hashlib.sha256(flags.encode()).hexdigest()[:16]


def _differences(run: Path, golden: Path, name: str, exactly: bool) -> Iterator[str]:
    ours, theirs = _rows(run / f"{name}.csv"), _rows(golden / f"{name}.csv")
    drifts = {
        (table, column): known.drift
        for experiment in names()
        for table, its in columns(experiment).items()
        for column, known in its.columns.items()
    }
    if len(ours) != len(theirs):
        yield f"{name}.csv: {len(ours)} rows, golden {len(theirs)}"
    for number, (row, wanted) in enumerate(zip(ours, theirs, strict=False), 1):
        for column in wanted:
            drift = None if exactly else drifts.get((name, column))
            if not _agree(row.get(column, ""), wanted[column], drift):
                yield f"{name}.csv: row {number}: {column} {row.get(column)}, golden {wanted[column]}"


def _agree(ours: str, golden: str, drift: Drift | None) -> bool:
    """``drift``: how far apart they may be; None if not at all."""
    if drift is None or drift == ANY_DRIFT or not (ours and golden):
        return drift == ANY_DRIFT or ours == golden
    return abs(float(ours) - float(golden)) <= drift.absolute + drift.share * abs(float(golden))


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
