"""What ``docs/readings.md``, which the package carries with it, says of one option."""

import re
from dataclasses import dataclass
from pathlib import Path

READINGS = Path(__file__).parent.parent / "docs" / "readings.md"


@dataclass(frozen=True)
class Reading:
    """One row of ``readings.md``."""

    item: str  # its number; two are joined by a comma
    open: str  # what the paper leaves open
    reading: str  # what midnet-bench does by default
    source: str  # where that is from


def readings_of(key: str) -> list[Reading]:
    """The rows of ``readings.md`` whose last column names the option ``key``, in their order."""
    found = []
    for line in READINGS.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 5 and key in re.findall(r"`([^`]+)`", cells[4]):
            found.append(Reading(*cells[:4]))
    return found
