"""``MapView``: what MIDNet makes of a frame, on the prior map, on a square of pixels."""

import numpy as np

from midnet_bench.drawing.canvas import Canvas, Picture
from midnet_bench.drawing.marks import paint_box
from midnet_bench.drawing.palette import DETECTION, FALSE_DETECTION, GUARD, WHITE
from midnet_bench.drawing.scene import Scene, view_of
from midnet_bench.drawing.world_view import MARGIN_M
from midnet_bench.experiments.guarded.arena import GuardedArena
from midnet_bench.midnet.pipeline import Explanation

SHADES = np.array(
    [WHITE, (205, 205, 205), (226, 226, 226), (70, 70, 70), (140, 140, 140), (240, 200, 40)], dtype=np.uint8
)
FREE, UNKNOWN, INFLATED, WALL, COMMON, FOREGROUND = range(len(SHADES))
"""What a cell is: of the prior map, or in grid C of some guard, or in grid D of one."""


class MapView:
    """The guards' grids laid over each other, the fused detections, and where guards believe to be."""

    def __init__(self, trial: GuardedArena) -> None:
        self._view = view_of(trial, MARGIN_M)
        of_prior = [trial.prior_map.data >= 100, trial.prior.data == 0, trial.prior_map.data < 0]
        codes = np.select(of_prior, [WALL, INFLATED, UNKNOWN], FREE).astype(np.uint8)
        self._prior = trial.prior_map.with_data(codes)

    def paint(self, picture: Picture, scene: Scene, explanation: Explanation) -> None:
        """Draw over ``picture``, (height, width, 3); what is off the prior map stays as it is."""
        codes = self._prior.data.copy()
        for view in explanation.views:
            left, low = view.crop.x1_gmap, view.crop.y1_gmap
            window = codes[low : low + view.d.height, left : left + view.d.width]
            window[(view.c.data == 0) & (window != FOREGROUND)] = COMMON
            window[view.d.data != 0] = FOREGROUND
        canvas = Canvas(picture, self._view)
        canvas.cells(self._prior.with_data(codes), SHADES)
        for robot in scene.guards:
            canvas.circle(robot.believed[:2], 4.0 / canvas.scale, GUARD, -1)
        for found in scene.detections:
            paint_box(canvas, found.box, found.is_false)
        for found in scene.detections:
            color = FALSE_DETECTION if found.is_false else DETECTION
            canvas.label((found.box.x_min, found.box.y_max), str(found.robot), color, 5, -8)
