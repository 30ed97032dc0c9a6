"""Python runs the compiled loops too, with ``NUMBA_DISABLE_JIT=1``, and trials have the same bytes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOM = """
name: Room
plane_m: [3.6, 3.6]
enclosure_m: [3.0, 3.0]
wall_thickness_m: 0.15
wall_height_m: 1.0
walls:
  - [[-1.5, -1.5], [1.5, -1.5], [1.5, 1.5], [-1.5, 1.5], [-1.5, -1.5]]
robots: {center_m: [-0.6, 0], spacing_m: 0.6}
mobile_intruders: {count: 1}
"""
"""a tenth of Map 2: most of Python's time goes into the cost of each cell"""
TRIALS = {
    "detection": "--arena room.yaml --set prior_map=exact --engine fast --frames 1 --robots 2",
    "labyrinth": "--arena room.yaml --set prior_map=exact --engine fast --robots 1 --intruders 1 --seeds 1 "
    "--set time_limit_s=0.15 --set escape_distance_m=0.5",
    "map": "room.yaml --engine fast --set time_limit_s=0.25",
}
"""command -> arguments of trials of tenths of a second"""


TIMES = ("timing.csv", "labyrinth_speed.csv")


def tables_of(command: str, folder: Path, **variables: str) -> dict[str, bytes]:
    """The CSV files that a process writes, by name, but for those of measured times."""
    (folder.parent / "room.yaml").write_text(ROOM)
    done = subprocess.run(
        [sys.executable, "-m", "midnet_bench", command, *TRIALS[command].split(), "-q", "-o", str(folder)],
        env={**os.environ, **variables},
        cwd=folder.parent,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Warning" not in done.stderr
    return {path.name: path.read_bytes() for path in folder.rglob("*.csv") if path.name not in TIMES}


@pytest.mark.slow
@pytest.mark.parametrize("command", TRIALS)
def test_a_trial_has_the_same_bytes_without_the_compiler(command: str, tmp_path: Path) -> None:
    compiled = tables_of(command, tmp_path / "compiled")
    interpreted = tables_of(command, tmp_path / "interpreted", NUMBA_DISABLE_JIT="1")
    assert compiled
    assert "failures.csv" not in compiled
    assert interpreted == compiled
