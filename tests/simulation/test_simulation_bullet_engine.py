"""PyBullet is asked for in one place, which says what to do without it and keeps it quiet."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from midnet_bench.robots.turtlebot3 import BURGER
from midnet_bench.simulation.bullet_engine import bullet
from tests.simulation.scenes import BulletWorld, scene


@pytest.mark.slow
def test_that_it_is_missing_is_an_import_error_that_says_what_to_do() -> None:
    program = (
        "import sys; sys.modules['pybullet'] = None\n"
        "try: import midnet_bench.simulation.bullet_engine\n"
        "except ImportError as error: print(error, error.exit_code)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    (line,) = done.stdout.splitlines()
    assert "take 'fast': --engine fast" in line
    assert line.endswith(" 2")
    assert done.stderr == ""


@pytest.mark.slow
def test_pybullet_greets_nobody_and_standard_error_stays_open() -> None:
    program = "import sys, midnet_bench.simulation.bullet_engine; print('a line of ours', file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "a line of ours\n")


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
