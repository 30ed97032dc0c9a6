"""PyBullet is asked for in one place, which says what to do without it and keeps it quiet."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from midnet_bench.robots.turtlebot3 import BURGER
from midnet_bench.simulation.bullet_engine import bullet
from tests.simulation.scenes import BulletWorld, scene

MISSING_AND_THERE = """
import sys
sys.modules["pybullet"] = None
try:
    import midnet_bench.simulation.bullet_engine
except ImportError as error:
    print(error, error.exit_code)
del sys.modules["pybullet"]
import midnet_bench.simulation.bullet_engine
print("a line of ours", file=sys.stderr)
"""


@pytest.mark.slow
def test_without_it_one_line_says_what_to_do_and_with_it_nobody_is_greeted() -> None:
    command = [sys.executable, "-c", MISSING_AND_THERE]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    (line,) = done.stdout.splitlines()
    assert "take 'fast': --engine fast" in line
    assert line.endswith(" 2")
    assert done.stderr == "a line of ours\n"


@pytest.mark.slow
def test_a_closed_standard_error_does_not_stop_it() -> None:
    program = "import midnet_bench.simulation.bullet_engine; print('imported')"
    command = ["sh", "-c", 'exec "$0" -c "$1" 2>&-', sys.executable, program]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "imported\n"


def connected() -> list[int]:
    return [client for client in range(100) if bullet.isConnected(client)]


def test_a_world_that_fails_to_build_keeps_no_client() -> None:
    layout = scene([(0.0, 0.0, 0.0)])
    with BulletWorld(layout):
        pass
    before = connected()
    for _ in range(3):
        with pytest.raises(bullet.error):
            BulletWorld(layout, robot=replace(BURGER, urdf=Path("/nowhere")))
    assert connected() == before
