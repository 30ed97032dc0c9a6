"""The lines of each room beside those that docs/architecture.md allows: ``python -m tests.rooms``."""

import re
from pathlib import Path

import midnet_bench

PACKAGE = Path(midnet_bench.__file__).parent
PAGE = Path(__file__).parents[1] / "docs" / "architecture.md"


def lines() -> dict[str, int]:
    """Room -> lines of Python, docstrings too; ``top`` for the modules beside the rooms."""
    counts: dict[str, int] = {}
    for path in PACKAGE.rglob("*.py"):
        room = path.relative_to(PACKAGE).parts[0] if path.parent != PACKAGE else "top"
        counts[room] = counts.get(room, 0) + path.read_text(encoding="utf-8").count("\n")
    return counts


def allowed() -> dict[str, tuple[int, int]]:
    """Room -> the most lines that it may have now, and those that it is meant to have."""
    rows = re.findall(r"^\| `(\w+)/?` \| (\d+) \| (\d+) \|$", PAGE.read_text(encoding="utf-8"), flags=re.M)
    return {room: (int(most), int(plan)) for room, most, plan in rows}


def main() -> None:
    """Print a line for each room, and the sum."""
    counts, limits = lines(), allowed()
    print(f"{'room':<14}{'lines':>7}{'most':>7}{'plan':>7}")
    for room in sorted(counts, key=lambda room: -counts[room]):
        most, plan = limits.get(room, (0, 0))
        print(f"{room:<14}{counts[room]:>7}{most:>7}{plan:>7}")
    sums = sum(counts.values()), *map(sum, zip(*limits.values(), strict=True))
    print(f"{'all':<14}" + "".join(f"{number:>7}" for number in sums))


if __name__ == "__main__":
    main()
