"""A log's mapping as pictures: its moments, six of them on a page, and a film of all."""

from pathlib import Path

import numpy as np

from midnet_bench.drawing.canvas import Canvas, Picture, text_mask, write
from midnet_bench.drawing.growth_view import (
    FREE,
    MOMENTS,
    TILE_PX,
    UNKNOWN,
    WALL,
    MapPainter,
    color_of,
    growth_page,
    paint_shade,
)
from midnet_bench.drawing.marks import BURGER_LENGTH_M, paint_burger
from midnet_bench.drawing.palette import INK, WHITE
from midnet_bench.drawing.recording import Moment, Recording
from midnet_bench.drawing.video import VideoFile
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.mapping.gmapping.filter import GMapping

LEAST_MARGIN_M, MARGIN_SHARE = 0.25, 0.02
LEAST_TILE_PX = 240

WIDTH, HEIGHT = 1280, 720
MAP_TOP = 80
LEFT, RIGHT = 16, 1264
SECOND_LINE, LEGEND_LEFT = 46, 752
PICTURES_PER_S = 10
LAST_PICTURE_S = 2.0


class LogRecording(Recording):
    """What the filter makes of a log while it goes through it."""

    def __init__(self) -> None:
        super().__init__()
        self._extents: list[tuple[float, float, float, float]] = []

    def look(self, done: int, slam: GMapping) -> None:
        """The next moment: the best particle's map and where it places the robot, now and until now."""
        grid = slam.occupancy()
        known_m2 = float(np.count_nonzero(grid.data >= 0)) * grid.resolution**2
        nobody_knows = np.empty((0, 3))
        believed = np.array([slam.best_pose])
        way = slam.trajectory.poses[:, :2]
        if grid.data.size:
            self._extents.append(grid.extent)
        self.take(Moment(float(done), known_m2, grid, nobody_knows, believed, [None], [way]))

    def view(self) -> Box:
        """What shows the map at every moment: before a loop closes, it may lie beside the last one."""
        extents = np.array(self._extents)
        view = Box(*extents[:, :2].min(axis=0).tolist(), *extents[:, 2:].max(axis=0).tolist())
        side_m = max(view.x_max - view.x_min, view.y_max - view.y_min)
        return view.shrunk(-max(LEAST_MARGIN_M, MARGIN_SHARE * side_m))


def log_page(recording: LogRecording, heading: str) -> Picture:
    """(height, width, 3) at most six moments from the first scan to the last, evenly spread."""
    clocks, view = recording.clocks, recording.view()
    chosen = np.unique(np.linspace(0, len(clocks) - 1, MOMENTS).round().astype(int)).tolist()
    high = (view.y_max - view.y_min) / (view.x_max - view.x_min)
    painter = MapPainter(view, TILE_PX, min(max(round(TILE_PX * high), LEAST_TILE_PX), TILE_PX))
    scans = clocks[-1]

    def caption(moment: Moment) -> str:
        return f"{_scans(moment, scans)}: {_known(moment)}"

    return growth_page(recording, [clocks[k] for k in chosen], painter, heading, caption)


def write_log_clip(recording: LogRecording, heading: str, path: Path) -> None:
    """Write an MP4 of all moments, about 20 seconds at most."""
    painter = MapPainter(recording.view(), WIDTH, HEIGHT - MAP_TOP)
    page, clocks = _clip_page(heading), recording.clocks
    still = [clocks[-1]] * round(LAST_PICTURE_S * PICTURES_PER_S)
    with VideoFile(path, WIDTH, HEIGHT, PICTURES_PER_S) as video:
        for clock in [*clocks, *still]:
            moment = recording.at(clock)
            picture = page.copy()
            painter.paint(picture[MAP_TOP:], moment)
            scans = _scans(moment, clocks[-1])
            write(picture, RIGHT - text_mask(scans, 20, True).shape[1], 10, scans, 20, INK, bold=True)
            write(picture, LEFT, SECOND_LINE, _known(moment), 16, INK)
            video.append(picture)


def _scans(moment: Moment, of: float) -> str:
    return f"scan {moment.clock:.0f} of {of:.0f}"


def _known(moment: Moment) -> str:
    return f"{moment.known:.0f} m² known"


def _clip_page(heading: str) -> Picture:
    """What stands still in a clip."""
    page = np.full((HEIGHT, WIDTH, 3), WHITE, dtype=np.uint8)
    write(page, LEFT, 10, heading, 20, INK, bold=True)
    left = LEGEND_LEFT
    for code, text in ((FREE, "free"), (WALL, "occupied"), (UNKNOWN, "unknown")):
        paint_shade(page, left, SECOND_LINE, code, text)
        left += 60 + text_mask(text, 13).shape[1]
    canvas = Canvas(page, Box(0.0, -HEIGHT, WIDTH, 0.0))
    y = -(SECOND_LINE + 9.0)
    paint_burger(canvas, Pose2D(left + 8.0, y, 0.0), 18.0 / BURGER_LENGTH_M, color_of(0))
    write(page, left + 28, SECOND_LINE, "robot", 13, INK)
    canvas.line([(left + 100.0, y), (left + 126.0, y)], color_of(0), 2)
    write(page, left + 134, SECOND_LINE, "its way", 13, INK)
    return page
