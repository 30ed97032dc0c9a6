"""``write_clip``: an exploration in motion: the growing map, and beside it the arena that is explored."""

from pathlib import Path

import numpy as np

from midnet_bench.drawing.canvas import Canvas, Picture, text_mask, write
from midnet_bench.drawing.exploration_view import painter_of, percent, team_of
from midnet_bench.drawing.growth_view import (
    FREE,
    UNKNOWN,
    WALL,
    color_of,
    paint_cross,
    paint_robots,
    paint_shade,
)
from midnet_bench.drawing.marks import BURGER_LENGTH_M, paint_burger, paint_standing
from midnet_bench.drawing.palette import FAINT_INK, INK, WHITE
from midnet_bench.drawing.recording import Recording
from midnet_bench.drawing.scene import title_of
from midnet_bench.drawing.video import VideoFile
from midnet_bench.experiments.mapping.trial import ExplorationTrial
from midnet_bench.geometry import Box, Pose2D

WIDTH, HEIGHT = 1280, 720
COLUMN_LEFT, COLUMN_RIGHT = 744, 1264
TRUTH_LEFT, TRUTH_TOP, TRUTH_PX = 764, 112, 480
LEGEND_TOP = 622
PICTURES_PER_S = 20
SPEEDS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
LONGEST_CLIP_S = 30.0
LAST_PICTURE_S = 2.0


def write_clip(trial: ExplorationTrial, recording: Recording, path: Path) -> None:
    """Write an MP4 of about half a minute at most; a short exploration is shown in real time."""
    begin_s, end_s = recording.clocks[0], recording.clocks[-1]
    speed = next((s for s in SPEEDS if end_s <= LONGEST_CLIP_S * s), SPEEDS[-1])
    painter, truth = painter_of(trial, HEIGHT), np.empty((TRUTH_PX, TRUTH_PX, 3), dtype=np.uint8)
    paint_standing(Canvas(truth, painter.view), trial)
    page = _clip_page(trial, speed, truth)
    times_s = np.arange(begin_s, end_s, speed / PICTURES_PER_S).tolist()
    still = [end_s] * round(LAST_PICTURE_S * PICTURES_PER_S)
    with VideoFile(path, WIDTH, HEIGHT, PICTURES_PER_S) as video:
        for time_s in [*times_s, *still]:
            moment = recording.at(time_s)
            picture = page.copy()
            painter.paint(picture[:, :HEIGHT], moment)
            there = picture[TRUTH_TOP : TRUTH_TOP + TRUTH_PX, TRUTH_LEFT : TRUTH_LEFT + TRUTH_PX]
            paint_robots(Canvas(there, painter.view), moment.poses)
            clock = f"{time_s:.0f} s"
            write(picture, COLUMN_RIGHT - text_mask(clock, 24, True).shape[1], 8, clock, 24, INK, bold=True)
            write(picture, COLUMN_LEFT, 62, f"{percent(moment.known)} explored", 18, INK, bold=True)
            video.append(picture)


def _clip_page(trial: ExplorationTrial, speed: int, truth: Picture) -> Picture:
    """What stands still in a clip."""
    page = np.full((HEIGHT, WIDTH, 3), WHITE, dtype=np.uint8)
    write(page, COLUMN_LEFT, 10, title_of(trial), 20, INK, bold=True)
    write(page, COLUMN_LEFT, 38, f"{team_of(trial)}; {speed} x real time", 14, INK)
    write(page, TRUTH_LEFT, TRUTH_TOP - 20, "the arena and the robots in it", 13, FAINT_INK)
    page[TRUTH_TOP : TRUTH_TOP + TRUTH_PX, TRUTH_LEFT : TRUTH_LEFT + TRUTH_PX] = truth
    canvas = Canvas(page, Box(0.0, -HEIGHT, WIDTH, 0.0))
    for row, (code, text) in enumerate(((FREE, "free"), (WALL, "occupied"), (UNKNOWN, "unknown"))):
        paint_shade(page, COLUMN_LEFT + 20, LEGEND_TOP + 24 * row - 9, code, text)
    left = COLUMN_LEFT + 180.0
    y = -float(LEGEND_TOP)
    paint_burger(canvas, Pose2D(left, y, 0.0), 18.0 / BURGER_LENGTH_M, color_of(0))
    canvas.line([(left - 14.0, y - 24.0), (left + 12.0, y - 24.0)], color_of(0), 2)
    paint_cross(canvas, (left, y - 48.0), color_of(0))
    for row, text in enumerate(
        ("robot, on the map where it takes itself to be", "its way", "the frontier it is driving to")
    ):
        write(page, round(left) + 24, LEGEND_TOP + 24 * row - 9, text, 13, INK)
    return page
