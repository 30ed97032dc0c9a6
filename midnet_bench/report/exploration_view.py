"""An exploration as pictures: the growing map with the robots' ways, and six moments of it on a page."""

import numpy as np

from midnet_bench.experiments.mapping import ExplorationTrial
from midnet_bench.geometry import Pose2D
from midnet_bench.report.canvas import Canvas, Floats, Picture, write
from midnet_bench.report.marks import BURGER_LENGTH_M, paint_burger
from midnet_bench.report.palette import EXPLORERS, INK, RGB, WHITE
from midnet_bench.report.recording import Moment, Recording
from midnet_bench.report.scene import Stage, title_of, view_of

MARGIN_M = 0.25
LEAST_BURGER_PX = 14.0
SHADES = np.array([WHITE, (205, 205, 205), (40, 40, 40)], dtype=np.uint8)
FREE, UNKNOWN, WALL = range(len(SHADES))


class MapPainter:
    """Paints the map of a moment on a square of pixels, with the robots where they take themselves to be."""

    def __init__(self, trial: Stage, side_px: int) -> None:
        self.view = view_of(trial, MARGIN_M)
        scale = Canvas(np.empty((side_px, side_px, 3), dtype=np.uint8), self.view).scale
        self.enlarged = max(1.0, LEAST_BURGER_PX / (BURGER_LENGTH_M * scale))
        """how many times as large as they are robots are drawn"""

    def paint(self, picture: Picture, moment: Moment) -> None:
        """Fill ``picture``, (side, side, 3)."""
        picture[:] = SHADES[UNKNOWN]
        canvas = Canvas(picture, self.view)
        data = moment.grid.data
        codes = np.select([data < 0, data >= 65], [UNKNOWN, WALL], FREE).astype(np.uint8)
        canvas.cells(moment.grid.with_data(codes), SHADES)
        for robot, way in enumerate(moment.ways):
            canvas.line(way, color_of(robot), 2)
        for robot, goal in enumerate(moment.goals):
            if goal is not None:
                paint_cross(canvas, goal, color_of(robot))
        paint_robots(canvas, moment.believed, self.enlarged)


def color_of(robot: int) -> RGB:
    """The colour of an explorer, counted from 0."""
    return EXPLORERS[robot % len(EXPLORERS)]


def paint_cross(canvas: Canvas, at: tuple[float, float], color: RGB) -> None:
    """Where a robot is going."""
    x, y = at
    arm = 5.0 / canvas.scale
    canvas.line([(x - arm, y - arm), (x + arm, y + arm)], color, 2)
    canvas.line([(x - arm, y + arm), (x + arm, y - arm)], color, 2)


def paint_robots(canvas: Canvas, poses: Floats, enlarged: float) -> None:
    """Burgers at (n, 3) poses; numbered if there are several."""
    for robot, pose in enumerate(poses.tolist()):
        paint_burger(canvas, Pose2D(*pose), enlarged, color_of(robot))
    for robot, (x, y, _) in enumerate(poses.tolist()):
        if len(poses) > 1:
            canvas.label((x, y), str(robot + 1), color_of(robot), 14, -14)


MOMENTS, COLUMNS = 6, 3
TILE_PX, GAP_PX, HEAD_PX, CAPTION_PX = 480, 12, 44, 26


def growth_page(trial: ExplorationTrial, recording: Recording) -> Picture:
    """(height, width, 3) six moments from the beginning to the end, evenly spread, in reading order."""
    painter = MapPainter(trial, TILE_PX)
    step = TILE_PX + GAP_PX
    rows = -(-MOMENTS // COLUMNS)
    page = np.full((HEAD_PX + rows * (step + CAPTION_PX), COLUMNS * step + GAP_PX, 3), WHITE, dtype=np.uint8)
    write(page, GAP_PX, 10, heading_of(trial), 20, INK, bold=True)
    for place, time_s in enumerate(np.linspace(recording.begin_s, recording.end_s, MOMENTS).tolist()):
        moment = recording.at(time_s)
        top = HEAD_PX + place // COLUMNS * (step + CAPTION_PX)
        left = GAP_PX + place % COLUMNS * step
        write(page, left, top, f"{time_s:.0f} s: {percent(moment.coverage)} explored", 16, INK)
        top += CAPTION_PX
        painter.paint(page[top : top + TILE_PX, left : left + TILE_PX], moment)
    return page


def heading_of(trial: ExplorationTrial) -> str:
    """Which exploration it is, in a line."""
    return f"{title_of(trial)}: {team_of(trial)}"


def team_of(trial: ExplorationTrial) -> str:
    """How many robots it was."""
    robots = trial.parameters.robots
    return f"explored by {robots} Burger{'s' if robots > 1 else ''}"


def percent(share: float) -> str:
    """A share with one digit, rounded down: nothing is called done that is not."""
    return f"{np.floor(1000.0 * share) / 10.0:.1f} %"
