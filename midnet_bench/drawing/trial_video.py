"""A guarded trial in motion: an MP4 with the true world beside what MIDNet makes of it, and a storyboard."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from midnet_bench.drawing import legend
from midnet_bench.drawing.canvas import Picture, blank_page, png_of, write
from midnet_bench.drawing.palette import FAINT_INK, INK
from midnet_bench.drawing.panels import DetectionPanel, WorldPanel
from midnet_bench.drawing.scene import Scene, Setup
from midnet_bench.drawing.video import mp4_file
from midnet_bench.io.files import write_atomically

WIDTH, HEIGHT = 1280, 720
COLUMN_LEFT, COLUMN_RIGHT = 744, 1264
MAP_LEFT, MAP_TOP, MAP_PX = 786, 84, 436
COUNTS_TOP, LEGEND_TOP, LEGEND_ROW_PX = 529, 566, 20
HOLD_S = 2.0
"""for so long the film shows its last picture, which has the outcome"""


@contextmanager
def trial_video(setup: Setup, directory: Path, speed: float) -> Iterator[Callable[[Scene], None]]:
    """What appends a scene to ``trial.mp4`` and ``storyboard.png`` in a folder.

    The files are there once the context ends without an error.

    Args:
        setup: of the trial.
        directory: where to.
        speed: how much faster than the trial's own time the video runs.

    Raises:
        InputError: the place cannot be written.
        MidnetBenchError: there is no room, or ffmpeg fails.
    """
    painter, storyboard = ScenePainter(setup, speed), Storyboard(setup)
    with mp4_file(directory / "trial.mp4", WIDTH, HEIGHT, setup.frame_hz * speed) as append_picture:
        last: list[Picture] = []

        def append(scene: Scene) -> None:
            last[:] = [painter.paint(scene)]
            append_picture(last[0])
            storyboard.offer(scene)

        yield append
        for picture in last * round(HOLD_S * setup.frame_hz * speed):
            append_picture(picture)
    write_atomically(directory / "storyboard.png", png_of(storyboard.page()))


class ScenePainter:
    """Paints the pictures of a trial's video. What never moves is painted once."""

    def __init__(self, setup: Setup, speed: float) -> None:
        """``speed``: how much faster than the trial's own time the video runs."""
        self._world = WorldPanel(setup, HEIGHT)
        self._detections = DetectionPanel(setup)
        self._page = blank_page(WIDTH, HEIGHT)
        intruders = setup.mobile_intruders + setup.other_intruders + len(setup.plan.stationary)
        team = (
            f"{setup.guards} guard{'s' * (setup.guards != 1)}, {intruders} intruder{'s' * (intruders != 1)}"
        )
        enlarged = self._world.enlarged
        size = f"; robots drawn {enlarged:.1f} times their size" if enlarged > 1.0 else ""
        write(self._page, COLUMN_LEFT, 10, setup.plan.title, 20, INK, bold=True)
        write(self._page, COLUMN_LEFT, 38, f"{team}; {speed:g} x real time{size}", 14, INK)
        write(self._page, MAP_LEFT, MAP_TOP - 20, "what MIDNet sees, on the prior map", 13, FAINT_INK)
        detections = [*legend.of_detections(numbered=True), *legend.of_grids()]
        for left, entries in ((COLUMN_LEFT + 8, legend.of_world(setup)), (COLUMN_LEFT + 254, detections)):
            legend.write_legend(self._page, entries, left, LEGEND_TOP, LEGEND_ROW_PX, 13)

    def paint(self, scene: Scene) -> Picture:
        """(720, 1280, 3) the trial at the scene's instant."""
        picture = self._page.copy()
        self._world.paint(picture[:, :HEIGHT], scene)
        beside = picture[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT : MAP_LEFT + MAP_PX]
        self._detections.paint(beside, scene)
        write(picture, COLUMN_RIGHT, 8, f"{scene.time_s:.1f} s", 24, INK, bold=True, before=1.0)
        write(picture, COLUMN_LEFT + 8, COUNTS_TOP, scene.counter, 14, INK, bold=True)
        write(picture, COLUMN_RIGHT, COUNTS_TOP, scene.remark, 14, INK, before=1.0)
        return picture


class Storyboard:
    """A page of scenes that are evenly spread over a trial, however long it turns out to be."""

    SCENES, COLUMNS = 6, 3
    TILE_PX, GAP_PX, LINE_PX = 400, 14, 23
    TEXT_PX, LABEL_PX = 18, 16
    """large enough for a page that is printed half as wide as paper"""
    TIME_PX = 84
    """room for the time before a scene's counter"""

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._world = WorldPanel(setup, self.TILE_PX, label_px=self.LABEL_PX)
        self._scenes: list[Scene] = []
        self._turns: list[Scene] = []
        """the scenes with something new in their remark, of a trial that is about catching"""
        self._last: Scene | None = None
        self._every = 1
        self._offered = 0

    def offer(self, scene: Scene) -> None:
        """The next frame; most are not kept."""
        scene = replace(scene, explanation=None)  # grids would fill the memory
        if scene.chase and scene.remark and (self._last is None or self._last.remark != scene.remark):
            self._turns.append(scene)
        if self._offered % self._every == 0:
            self._scenes.append(scene)
            # never more than four times what will be shown
            if len(self._scenes) > 4 * self.SCENES:
                self._scenes, self._every = self._scenes[::2], 2 * self._every
        self._last = scene
        self._offered += 1

    def chosen(self) -> list[Scene]:
        """The first frame, the last one, the last catches and escapes, and others at even distances."""
        if self._last is None:
            return []
        kept = {scene.frame: scene for scene in [*self._scenes, self._last]}
        fixed = {scene.frame: scene for scene in self._turns[1 - self.SCENES :]}
        frames = sorted(kept)
        even = np.linspace(0, len(frames) - 1, min(self.SCENES, len(frames))).round().astype(int).tolist()
        # from both ends inwards: the first and the last scene tell the most
        fixed = {self._last.frame: self._last, **fixed}
        for place in sorted(even, key=lambda place: min(place, len(frames) - 1 - place)):
            if len(fixed) < self.SCENES:
                fixed[frames[place]] = kept[frames[place]]
        return [fixed[frame] for frame in sorted(fixed)]

    def page(self) -> Picture:
        """(height, width, 3) the chosen scenes in reading order."""
        chosen = self.chosen()
        step = self.TILE_PX + self.GAP_PX
        width = self.COLUMNS * step + self.GAP_PX
        shown = [*legend.of_world(self._setup, chosen), *legend.of_detections(chosen)]
        entries = legend.beside(shown, self.GAP_PX, width, 16)
        head_px = 44 + self.LINE_PX * (1 + max((row for *_, row in entries), default=0)) + 4
        caption_px = self.LINE_PX * (2 if any(scene.remark for scene in chosen) else 1) + 4
        rows = -(-len(chosen) // self.COLUMNS)
        page = blank_page(width, head_px + rows * (step + caption_px))
        write(page, self.GAP_PX, 8, self._setup.plan.title, 22, INK, bold=True)
        legend.write_beside(page, entries, 44 + 10, self.LINE_PX, 16)
        told = ""
        for place, scene in enumerate(chosen):
            top = head_px + place // self.COLUMNS * (step + caption_px)
            left = self.GAP_PX + place % self.COLUMNS * step
            write(page, left, top, f"{scene.time_s:.1f} s", self.TEXT_PX, INK, bold=True)
            write(page, left + self.TIME_PX, top, scene.counter, self.TEXT_PX, INK)
            if scene.remark != told:  # a catch is told once
                told = scene.remark
                write(page, left, top + self.LINE_PX, told, 16, INK)
            top += caption_px
            self._world.paint(page[top : top + self.TILE_PX, left : left + self.TILE_PX], scene)
        return page
