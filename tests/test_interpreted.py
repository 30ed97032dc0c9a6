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
RUN = """
import sys
from midnet_bench.cli import main
for line in sys.argv[1:]:
    sys.argv = ["midnet-bench", *line.split()]
    try:
        main()
    except SystemExit as ended:
        if ended.code:
            raise
"""
"""commands one after the other in one process"""


def tables_of(folder: Path, **variables: str) -> dict[str, bytes]:
    """The CSV files that a process writes, by their paths, but for those of measured times."""
    folder.mkdir()
    (folder / "room.yaml").write_text(ROOM)
    lines = [f"{command} {arguments} -q -o {command}" for command, arguments in TRIALS.items()]
    done = subprocess.run(
        [sys.executable, "-c", RUN, *lines],
        env={**os.environ, **variables},
        cwd=folder,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Warning" not in done.stderr
    files = [path for path in folder.rglob("*.csv") if path.name not in TIMES]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


@pytest.mark.slow
def test_trials_have_the_same_bytes_without_the_compiler(tmp_path: Path) -> None:
    compiled = tables_of(tmp_path / "compiled")
    assert {name.partition("/")[0] for name in compiled} == set(TRIALS)
    assert not [name for name in compiled if name.endswith("failures.csv")]
    assert tables_of(tmp_path / "interpreted", NUMBA_DISABLE_JIT="1") == compiled
