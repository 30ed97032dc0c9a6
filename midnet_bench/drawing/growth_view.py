"""A growing map as pictures: the map of a moment with the robots and their ways, and a page of moments."""

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from midnet_bench.drawing.canvas import Canvas, Floats, Picture, write
from midnet_bench.drawing.marks import BURGER_LENGTH_M, paint_burger
from midnet_bench.drawing.palette import EXPLORERS, FAINT_INK, INK, RGB, WHITE
from midnet_bench.drawing.recording import Moment, Recording
from midnet_bench.geometry import Box, Pose2D

LEAST_BURGER_PX = 14.0
SHADES = np.array([WHITE, (205, 205, 205), (40, 40, 40)], dtype=np.uint8)
FREE, UNKNOWN, WALL = range(len(SHADES))
_CODES = np.repeat(np.array([FREE, WALL, UNKNOWN], dtype=np.uint8), (65, 63, 128))
"""of each value of a map's cell, -1 and below at the end as in its bytes"""


class MapPainter:
    """Paints the map of a moment with the robots where they take themselves to be."""

    def __init__(self, view: Box, width_px: int, height_px: int) -> None:
        """``view``: what the pictures show, metres of the map frame."""
        self.view = view
        self.width_px, self.height_px = width_px, height_px

    def paint(self, picture: Picture, moment: Moment) -> None:
        """Fill ``picture``, (height, width, 3)."""
        picture[:] = SHADES[UNKNOWN]
        canvas = Canvas(picture, self.view)
        codes = _CODES[moment.grid.data.view(np.uint8)]
        cells_per_px = 1.0 / (canvas.scale * moment.grid.resolution)
        if cells_per_px > 1.0 and codes.size:
            # a pixel shows one of its cells; a wall one cell thick must be seen whichever that is
            side = int(np.ceil(cells_per_px))
            walls = (codes == WALL).astype(np.uint8)
            codes[cv2.dilate(walls, np.ones((side, side), dtype=np.uint8)) > 0] = WALL
        canvas.cells(moment.grid.with_data(codes), SHADES)
        for robot, way in enumerate(moment.ways):
            canvas.line(way, color_of(robot), 2)
        for robot, goal in enumerate(moment.goals):
            if goal is not None:
                paint_cross(canvas, goal, color_of(robot))
        paint_robots(canvas, moment.believed)


def color_of(robot: int) -> RGB:
    """The colour of a robot that maps, counted from 0."""
    return EXPLORERS[robot % len(EXPLORERS)]


def paint_cross(canvas: Canvas, at: tuple[float, float], color: RGB) -> None:
    """Where a robot is going."""
    x, y = at
    arm = 5.0 / canvas.scale
    canvas.line([(x - arm, y - arm), (x + arm, y + arm)], color, 2)
    canvas.line([(x - arm, y + arm), (x + arm, y - arm)], color, 2)


def paint_robots(canvas: Canvas, poses: Floats) -> None:
    """Burgers at (n, 3) poses, large enough to be seen; numbered if there are several."""
    enlarged = max(1.0, LEAST_BURGER_PX / (BURGER_LENGTH_M * canvas.scale))
    for robot, pose in enumerate(poses.tolist()):
        paint_burger(canvas, Pose2D(*pose), enlarged, color_of(robot))
    for robot, (x, y, _) in enumerate(poses.tolist()):
        if len(poses) > 1:
            canvas.label((x, y), str(robot + 1), color_of(robot), 14, -14)


def paint_shade(page: Picture, left: int, top: int, code: int, text: str) -> None:
    """A line of a legend: what a shade of the map means."""
    red, green, blue = SHADES[code].tolist()
    cv2.rectangle(page, (left, top + 3), (left + 16, top + 15), (red, green, blue), -1)
    cv2.rectangle(page, (left, top + 3), (left + 16, top + 15), FAINT_INK, 1)
    write(page, left + 26, top, text, 13, INK)


MOMENTS, COLUMNS = 6, 3
TILE_PX, GAP_PX, HEAD_PX, CAPTION_PX = 480, 12, 44, 26


def growth_page(
    recording: Recording,
    clocks: Sequence[float],
    painter: MapPainter,
    heading: str,
    caption: Callable[[Moment], str],
) -> Picture:
    """(height, width, 3) the moments at ``clocks`` in reading order, each under its caption."""
    across, down = painter.width_px + GAP_PX, painter.height_px + GAP_PX + CAPTION_PX
    rows = -(-len(clocks) // COLUMNS)
    page = np.full((HEAD_PX + rows * down, COLUMNS * across + GAP_PX, 3), WHITE, dtype=np.uint8)
    write(page, GAP_PX, 10, heading, 20, INK, bold=True)
    for place, clock in enumerate(clocks):
        moment = recording.at(clock)
        top = HEAD_PX + place // COLUMNS * down
        left = GAP_PX + place % COLUMNS * across
        write(page, left, top, caption(moment), 16, INK)
        top += CAPTION_PX
        painter.paint(page[top : top + painter.height_px, left : left + painter.width_px], moment)
    return page


def png_of_picture(picture: Picture) -> bytes:
    """A picture as a PNG file."""
    _, png = cv2.imencode(".png", picture[..., ::-1])
    return png.tobytes()
