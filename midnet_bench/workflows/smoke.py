"""A small run against committed numbers: to the byte on the platform that made them, else within bounds."""

import csv
import hashlib
import json
from collections.abc import Iterator
from pathlib import Path

from midnet_bench.campaign.provenance import Provenance, collect
from midnet_bench.errors import InputError
from midnet_bench.io.files import write_atomically

PLATFORM = "platform.json"
SAME_PLATFORM = ("machine", "processor", "python", "libraries")
BOUNDS = {
    "precision": (0.1, 0.0),
    "recall": (0.1, 0.0),
    "f1": (0.1, 0.0),
    "in_range": (0.0, 0.2),
    "distance_m": (1.0, 0.3),
    "walls_crossed": (0.0, 0.0),
}
"""column -> how far another platform's number may lie off, absolutely plus as a share of the golden one:
physics in floating point parts ways between processors, and after a minute robots are elsewhere"""


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
    if len(ours) != len(theirs):
        yield f"{name}.csv: {len(ours)} rows, golden {len(theirs)}"
    for number, (row, wanted) in enumerate(zip(ours, theirs, strict=False), 1):
        for column in wanted:
            if not _agree(column, row.get(column, ""), wanted[column], exactly):
                yield f"{name}.csv: row {number}: {column} {row.get(column)}, golden {wanted[column]}"


def _agree(column: str, ours: str, golden: str, exactly: bool) -> bool:
    if exactly:
        return ours == golden
    if column not in BOUNDS:
        return True
    if not (ours and golden):
        return ours == golden
    absolute, share = BOUNDS[column]
    return abs(float(ours) - float(golden)) <= absolute + share * abs(float(golden))


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))
