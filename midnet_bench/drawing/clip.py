"""``Clip``: a trial in motion: the true world, and beside it what MIDNet makes of it."""

import numpy as np

from midnet_bench.drawing.canvas import Canvas, Floats, Picture, text_mask, write
from midnet_bench.drawing.map_view import COMMON, FOREGROUND, INFLATED, SHADES, MapView
from midnet_bench.drawing.marks import BURGER_LENGTH_M, paint_box, paint_burger, paint_way
from midnet_bench.drawing.palette import FAINT_INK, GUARD, INK, INTRUDER, INTRUDER_FAINT, WHITE
from midnet_bench.drawing.scene import Scene, title_of
from midnet_bench.drawing.world_view import WorldView
from midnet_bench.experiments.guarded.arena import GuardedArena
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.midnet.pipeline import Explanation

WIDTH, HEIGHT = 1280, 720
COLUMN_LEFT, COLUMN_RIGHT = 744, 1264
MAP_LEFT, MAP_TOP, MAP_PX = 764, 84, 480
COUNTS_TOP, LEGEND_TOP = 574, 613


class Clip:
    """Paints one picture per MIDNet frame. What never moves is painted once."""

    def __init__(self, trial: GuardedArena, speed: float) -> None:
        """``speed``: how much faster than the trial's own time it is going to be shown."""
        self._world = WorldView(trial, HEIGHT)
        self._map = MapView(trial)
        self._page = np.full((HEIGHT, WIDTH, 3), WHITE, dtype=np.uint8)
        _write_title(self._page, trial, speed, self._world.enlarged)
        _draw_legend(self._page)

    def paint(self, scene: Scene, explanation: Explanation) -> Picture:
        """(720, 1280, 3) the trial at the scene's instant."""
        picture = self._page.copy()
        self._world.paint(picture[:, :HEIGHT], scene)
        self._map.paint(picture[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT : MAP_LEFT + MAP_PX], scene, explanation)
        clock = f"{scene.time_s:.1f} s"
        write(picture, COLUMN_RIGHT - text_mask(clock, 24, True).shape[1], 8, clock, 24, INK, bold=True)
        boxes, false = len(scene.detections), sum(found.is_false for found in scene.detections)
        counts = f"detections: {boxes}, of which touch no intruder: {false}"
        write(picture, COLUMN_LEFT + 8, COUNTS_TOP, counts, 14, INK)
        return picture


def _write_title(page: Picture, trial: GuardedArena, speed: float, enlarged: float) -> None:
    write(page, COLUMN_LEFT, 10, title_of(trial), 20, INK, bold=True)
    intruders = len(trial.intruders) + len(trial.layout.stationary)
    size = f"; robots drawn {enlarged:.1f} times as large" if enlarged > 1.0 else ""
    heading = f"guards {len(trial.guards)}, intruders {intruders}; {speed:g} x real time{size}"
    write(page, COLUMN_LEFT, 38, heading, 14, INK)
    write(page, MAP_LEFT, MAP_TOP - 20, "what MIDNet sees, on the prior map", 13, FAINT_INK)


def _draw_legend(page: Picture) -> None:
    """Two columns under the map: marks of the world, and marks of the map."""
    canvas = Canvas(page, Box(0.0, -HEIGHT, WIDTH, 0.0))
    of_world, of_map = COLUMN_LEFT + 16, COLUMN_LEFT + 262
    rows = [-(LEGEND_TOP + 23 * row) for row in range(5)]

    for y, color in ((rows[0], GUARD), (rows[1], INTRUDER)):
        paint_burger(canvas, Pose2D(of_world + 4.0, y, 0.0), 18.0 / BURGER_LENGTH_M, color)
    canvas.polygon(_swatch(of_world, rows[2]), INTRUDER_FAINT, INTRUDER, 2)
    for y, is_guard in ((rows[3], True), (rows[4], False)):
        way = np.array([(of_world - 14.0, y), (of_world + 10.0, y)])
        paint_way(canvas, (of_world + 12.0, y), way, GUARD if is_guard else INTRUDER, is_guard)

    for y, is_false in ((rows[0], False), (rows[1], True)):
        paint_box(canvas, Box(of_map - 8.0, y - 7.0, of_map + 8.0, y + 7.0), is_false)
    for y, code in ((rows[2], FOREGROUND), (rows[3], COMMON), (rows[4], INFLATED)):
        red, green, blue = SHADES[code].tolist()
        canvas.polygon(_swatch(of_map, y), (red, green, blue))

    texts = (
        ("guard", "detection, with its guard's number"),
        ("mobile intruder", "detection that touches no intruder"),
        ("stationary intruder", "seen, not on the prior map (D)"),
        ("way and goal of a guard", "seen, on the prior map (C)"),
        ("way and goal of an intruder", "margin of the prior map (Eq. 1)"),
    )
    for y, (world, seen) in zip(rows, texts, strict=True):
        write(page, of_world + 24, -y - 9, world, 13, INK)
        write(page, of_map + 18, -y - 9, seen, 13, INK)


def _swatch(x: float, y: float) -> Floats:
    return np.array([(x - 8.0, y - 6.0), (x + 8.0, y - 6.0), (x + 8.0, y + 6.0), (x - 8.0, y + 6.0)])
