"""Screens of the program at 80 columns, text files in ``screens/``; run as a module to write them anew."""

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

from midnet_bench.cli.app import PANELS
from tests.cli.command import midnet_bench, unpainted
from tests.stores import detection_store, labyrinth_store

FOLDER = Path(__file__).parent / "screens"
RESULTS = {
    "result-report-detection": ("report", "detection"),
    "result-report-labyrinth": ("report", "labyrinth"),
    "result-verify": ("verify", "detection"),
    "result-compare": ("compare", "detection", "other"),
}
"""name of a screen -> the command on campaigns whose trials were written down"""


def screens() -> Iterator[tuple[str, str]]:
    """Each screen's name and text, without blanks at the ends of lines."""
    commands = {"midnet-bench": ("-h",)}
    commands |= {f"help-{name}": (name, "-h") for names in PANELS.values() for name in names}
    with tempfile.TemporaryDirectory() as place, mock.patch.dict(os.environ, {"COLUMNS": "80"}):
        folder = Path(place)
        scores = {
            1: {1: (0.99, 0.7, 0.82), 2: (0.98, 0.72, 0.83), 3: (0.97, 0.75, 0.84)},
            5: {1: (0.95, 0.9, 0.92), 2: (0.96, 0.93, 0.94), 3: (0.94, 0.95, 0.945)},
        }
        detection_store(folder / "detection", scores)
        more = {
            robots: {seed: (p, min(r + 0.02 * seed, 1.0), f) for seed, (p, r, f) in rows.items()}
            for robots, rows in scores.items()
        }
        detection_store(folder / "other", more, parameters={"local_size_m": 6.0})
        (folder / "labyrinth").mkdir()
        labyrinth_store(
            folder / "labyrinth" / "campaign.sqlite", lambda k, n, seed: min(k, n + seed % 2), seeds=5
        ).close()
        for name, arguments in (commands | RESULTS).items():
            with unpainted():
                done = midnet_bench(*arguments, folder=folder)
            lines = [line.rstrip() for line in (done.stdout + done.stderr).splitlines()]
            yield name, "\n".join(lines).strip("\n") + "\n"


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, text in screens():
        (FOLDER / f"{name}.txt").write_text(text, encoding="utf-8")
