"""The lines of each room and the difference to the last commit, as information: ``python -m tests.rooms``."""

import subprocess
from collections import Counter
from pathlib import Path

import midnet_bench

PACKAGE = Path(midnet_bench.__file__).parent
TOP = "top"
"""stands for the modules beside the rooms"""


def room_of(parts: tuple[str, ...]) -> str:
    """The room of a file with this path inside the package."""
    return parts[0] if len(parts) > 1 else TOP


def lines() -> Counter[str]:
    """Room -> lines of Python, docstrings too."""
    counts: Counter[str] = Counter()
    for path in PACKAGE.rglob("*.py"):
        counts[room_of(path.relative_to(PACKAGE).parts)] += path.read_bytes().count(b"\n")
    return counts


def lines_added() -> Counter[str]:
    """Room -> lines added less lines removed since the last commit; none where git has no answer."""
    command = ["git", "diff", "--numstat", "--no-renames", "--relative", "HEAD", "--", "*.py"]
    answer = subprocess.run(command, cwd=PACKAGE, capture_output=True, text=True).stdout
    counts: Counter[str] = Counter()
    for line in answer.splitlines():
        added, removed, path = line.split("\t")
        counts[room_of(Path(path).parts)] += int(added) - int(removed)
    return counts


def main() -> None:
    """Print a line for each room, and the sum."""
    counts, added = lines(), lines_added()
    print(f"{'room':<14}{'lines':>7}{'added':>7}")
    for room, count in counts.most_common():
        print(f"{room:<14}{count:>7}{added[room]:>+7}")
    print(f"{'all':<14}{counts.total():>7}{added.total():>+7}")


if __name__ == "__main__":
    main()
