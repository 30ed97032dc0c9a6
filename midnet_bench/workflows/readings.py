"""What ``docs/readings.md``, which the package carries with it, says of one option."""

import re
from dataclasses import dataclass
from pathlib import Path

READINGS = Path(__file__).parent.parent / "docs" / "readings.md"


@dataclass(frozen=True)
class Reading:
    """One row of ``readings.md``."""

    item: str
    """its number; two are joined by a comma"""
    open: str
    """what the paper leaves open"""
    reading: str
    """what midnet-bench does by default"""


def readings_of(key: str) -> list[Reading]:
    """The rows of ``readings.md`` whose last column names the option ``key``, in their order."""
    found = []
    for line in READINGS.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 4 and key in re.findall(r"`([^`]+)`", cells[3]):
            found.append(Reading(*cells[:3]))
    return found
