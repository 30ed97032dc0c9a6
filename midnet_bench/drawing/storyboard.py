"""``Storyboard``: a dozen moments of a clip on one page."""

import numpy as np

from midnet_bench.drawing.canvas import Picture, text_mask, write
from midnet_bench.drawing.palette import DETECTION, FALSE_DETECTION, GUARD, INK, INTRUDER, WHITE
from midnet_bench.drawing.scene import Scene, title_of
from midnet_bench.drawing.world_view import WorldView
from midnet_bench.experiments.guarded.arena import GuardedArena

MOMENTS, COLUMNS = 12, 4
TILE_PX, GAP_PX, HEAD_PX, CAPTION_PX = 480, 12, 44, 24
LEGEND = (
    ("guards", GUARD),
    ("intruders", INTRUDER),
    ("detections", DETECTION),
    ("crossed out: detections that touch no intruder", FALSE_DETECTION),
)


class Storyboard:
    """Keeps moments that are evenly spread over a trial, however long it turns out to be."""

    def __init__(self, trial: GuardedArena) -> None:
        self._title = title_of(trial)
        self._world = WorldView(trial, TILE_PX)
        self._scenes: list[Scene] = []
        self._every = 1
        self._offered = 0

    def offer(self, scene: Scene) -> None:
        """The next frame; most are not kept."""
        if self._offered % self._every == 0:
            self._scenes.append(scene)
            # never more than four times what will be shown
            if len(self._scenes) > 4 * MOMENTS:
                self._scenes, self._every = self._scenes[::2], 2 * self._every
        self._offered += 1

    def moments(self) -> list[Scene]:
        """The first frame, the last one kept and those between at even distances; at most a dozen."""
        last = len(self._scenes) - 1
        picked = np.linspace(0, last, min(MOMENTS, last + 1)).round().astype(int)
        return [self._scenes[index] for index in picked.tolist()]

    def page(self) -> Picture:
        """(height, width, 3) the moments in reading order."""
        moments = self.moments()
        step = TILE_PX + GAP_PX
        height = HEAD_PX + -(-len(moments) // COLUMNS) * (step + CAPTION_PX)
        page = np.full((height, COLUMNS * step + GAP_PX, 3), WHITE, dtype=np.uint8)
        write(page, GAP_PX, 8, self._title, 20, INK, bold=True)
        left = GAP_PX + step
        for text, color in LEGEND:
            write(page, left, 11, text, 16, color, bold=True)
            left += text_mask(text, 16, True).shape[1] + 3 * GAP_PX
        for place, scene in enumerate(moments):
            top = HEAD_PX + place // COLUMNS * (step + CAPTION_PX)
            left = GAP_PX + place % COLUMNS * step
            write(page, left, top, f"{scene.time_s:.1f} s", 16, INK)
            top += CAPTION_PX
            self._world.paint(page[top : top + TILE_PX, left : left + TILE_PX], scene)
        return page
