"""How many files of the package a reader opens to follow a frame, a control cycle and a command."""

from importlib.util import find_spec

import pytest

from benchmarks.files_opened import WORLD, command, control_cycle, midnet_frame

MOST_OF_A_FRAME = 16
MOST_OF_A_CYCLE = 9
MOST_OF_A_CYCLES_WORLD = 5
MOST_OF_A_COMMAND, MOST_MOVES = 44, 650


@pytest.mark.slow
def test_a_frame_and_a_control_cycle_can_be_followed() -> None:
    assert len(midnet_frame()) <= MOST_OF_A_FRAME
    cycle = control_cycle()
    world = {name for name in cycle if name.startswith(WORLD)}
    assert len(cycle - world) <= MOST_OF_A_CYCLE
    assert len(world) <= MOST_OF_A_CYCLES_WORLD


@pytest.mark.slow
@pytest.mark.skipif(find_spec("pybullet") is None, reason="the figure is of PyBullet's engine")
def test_a_command_of_one_cell_enters_few_files_and_seldom_moves_between_them() -> None:
    files, moves = command()
    assert len(files) <= MOST_OF_A_COMMAND
    assert moves <= MOST_MOVES
