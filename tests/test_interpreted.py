"""Python runs the compiled loops too, with ``NUMBA_DISABLE_JIT=1``, and trials have the same bytes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

TRIALS = {
    "detection": "--engine fast --frames 1 --robots 2 --detector midnet,clusters,subtraction,background",
    "labyrinth": "--robots 1 --intruders 1 --seeds 1 --set time_limit_s=0.15",
    "map": "map2 --engine fast --set time_limit_s=0.25",
}
"""command -> arguments of trials of tenths of a second; Python needs half a minute for each second"""


TIMES = ("timing.csv", "labyrinth_speed.csv")


def tables_of(command: str, folder: Path, disabled: str) -> dict[str, bytes]:
    """The CSV files that a process writes, by name, but for those of measured times."""
    done = subprocess.run(
        [sys.executable, "-m", "midnet_bench", command, *TRIALS[command].split(), "-q", "-o", str(folder)],
        env={**os.environ, "NUMBA_DISABLE_JIT": disabled},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Warning" not in done.stderr
    return {path.name: path.read_bytes() for path in folder.rglob("*.csv") if path.name not in TIMES}


@pytest.mark.slow
@pytest.mark.parametrize("command", TRIALS)
def test_a_trial_has_the_same_bytes_without_the_compiler(command: str, tmp_path: Path) -> None:
    compiled = tables_of(command, tmp_path / "compiled", "0")
    interpreted = tables_of(command, tmp_path / "interpreted", "1")
    assert compiled
    assert "failures.csv" not in compiled
    assert interpreted == compiled
