"""Pictures of recordings: what the map does not know outputs unknown, and the drive fills the picture."""

import numpy as np
import pytest

from midnet_bench.drawing.painter import Canvas, paint_floor_plan
from midnet_bench.drawing.palette import FLOOR, GROUND
from midnet_bench.geometry import Box
from midnet_bench.grid import OccupancyGrid
from midnet_bench.workflows.replay_output import boxed, plan_of


def a_map() -> OccupancyGrid:
    """Ten metres square: the left half is known, and free but for a wall."""
    data = np.full((100, 100), -1, dtype=np.int8)
    data[:, :50] = 0
    data[20:80, 10] = 100
    return OccupancyGrid(data, 0.1, (-5.0, -5.0))


def test_unknown_cells_do_not_look_like_floor() -> None:
    plan = plan_of("drive", a_map())
    canvas = Canvas(np.zeros((200, 200, 3), dtype=np.uint8), Box(-5.0, -5.0, 5.0, 5.0))
    paint_floor_plan(canvas, plan)
    assert tuple(canvas.picture[100, 80].tolist()) == FLOOR
    assert tuple(canvas.picture[100, 150].tolist()) == GROUND


def test_pictures_are_cropped_to_the_drive_within_the_known_map() -> None:
    assert tuple(plan_of("drive", a_map()).view(0.0)) == pytest.approx((-5.0, -5.0, 0.0, 5.0), abs=0.11)
    cropped = plan_of("drive", a_map(), Box(-3.0, -9.0, 4.0, 1.0)).view(0.5)
    assert tuple(cropped) == pytest.approx((-3.5, -5.5, 0.5, 1.5))
    off = plan_of("drive", a_map(), Box(20.0, 20.0, 21.0, 21.0))
    assert off.shown is None


def test_a_recorded_robot_is_the_box_of_its_footprint() -> None:
    assert boxed(((0.1, 0.0), (0.0, 0.2), (-0.3, -0.1))) == (
        (-0.3, -0.1),
        (0.1, -0.1),
        (0.1, 0.2),
        (-0.3, 0.2),
    )
