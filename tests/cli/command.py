"""The real command, in a process of its own."""

import csv
import os
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).parents[2]
MAP_KEYS = {
    "image": "map.pgm",
    "resolution": 0.05,
    "origin": [-4.0, -4.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
"""a map of Map 1's size, which ``map.pgm`` beside it has the cells of"""


def midnet_bench(*arguments: object, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "midnet_bench", *map(str, arguments)]
    environment = {**os.environ, "NO_COLOR": "1", "PYTHONPATH": str(REPOSITORY)}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def one_line_of_complaint(done: subprocess.CompletedProcess[str]) -> str:
    """What a command says to wrong input: exit code 2, and one line on stderr, which comes back."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    (complaint,) = done.stderr.strip().splitlines()
    return complaint
