"""How many files of the package a reader opens to follow a frame and a control cycle."""

from benchmarks.files_opened import WORLD, control_cycle, midnet_frame

MOST_OF_A_FRAME = 15
MOST_OF_A_CYCLE = 9
MOST_OF_A_CYCLES_WORLD = 5


def test_a_frame_and_a_control_cycle_can_be_followed() -> None:
    assert len(midnet_frame()) <= MOST_OF_A_FRAME
    cycle = control_cycle()
    world = {name for name in cycle if name.startswith(WORLD)}
    assert len(cycle - world) <= MOST_OF_A_CYCLE
    assert len(world) <= MOST_OF_A_CYCLES_WORLD
