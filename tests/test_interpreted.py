"""Python runs the compiled loops too, with ``NUMBA_DISABLE_JIT=1``, and trials have the same bytes."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import campaign_folder

REPOSITORY = Path(__file__).parents[1]
ROOM = """
name: Room
plane_m: [2.8, 2.8]
enclosure_m: [2.4, 2.4]
wall_thickness_m: 0.15
wall_height_m: 1.0
walls:
  - [[-1.2, -1.2], [1.2, -1.2], [1.2, 1.2], [-1.2, 1.2], [-1.2, -1.2]]
robots: {center_m: [-0.4, 0], spacing_m: 0.6}
mobile_intruders: {count: 1}
"""
"""a seventieth of Map 2: most of Python's time goes into the cost of each cell"""
SMALL = {"prior_map": "exact", "local_size_m": 2.0}
TRIALS: dict[str, dict[str, Any]] = {
    "detection": {**SMALL, "frames": 1, "robots": 2},
    "labyrinth": {**SMALL, "robots": 1, "intruders": 1, "time_limit_s": 0.15, "escape_distance_m": 0.5},
    "mapping": {"time_limit_s": 0.25, "robots": 1},
}
"""experiment -> parameters of a trial of tenths of a second"""
TIMES = ("timing.csv", "labyrinth_speed.csv")


def run_trials(folder: Path) -> None:
    """A trial of each experiment in a small room, its tables as CSV files in a folder of ``folder``."""
    (folder / "room.yaml").write_text(ROOM)
    for name, trial in TRIALS.items():
        parameters = {"arena": str(folder / "room.yaml"), "engine": "fast", **trial}
        campaign_folder(folder / name, experiment=name, parameters=parameters, trials=1)


def tables_in(folder: Path) -> dict[str, bytes]:
    """The CSV files below ``folder`` by their paths, but for those of measured times."""
    files = [path for path in folder.rglob("*.csv") if path.name not in TIMES]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.mark.slow
def test_trials_have_the_same_bytes_without_the_compiler(tmp_path: Path) -> None:
    for name in ("compiled", "interpreted"):
        (tmp_path / name).mkdir()
    run_trials(tmp_path / "compiled")
    code = "import sys, pathlib, tests.test_interpreted as t; t.run_trials(pathlib.Path(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "interpreted"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(REPOSITORY)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr
    compiled = tables_in(tmp_path / "compiled")
    assert {name.partition("/")[0] for name in compiled} == set(TRIALS)
    assert tables_in(tmp_path / "interpreted") == compiled
