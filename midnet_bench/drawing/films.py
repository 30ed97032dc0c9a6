"""Films: pictures in, an MP4 out that every browser plays; a guarded trial in motion, and its storyboard."""

import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from midnet_bench.drawing.painter import (
    DetectionPanel,
    Picture,
    WorldPanel,
    blank_page,
    detection_legend,
    grid_legend,
    legend_rows,
    png_of,
    tiles,
    world_legend,
    write,
    write_legend,
)
from midnet_bench.drawing.palette import FAINT_INK
from midnet_bench.drawing.scene import Scene, Setup
from midnet_bench.errors import MidnetBenchError
from midnet_bench.io.files import temporary_path, write_atomically

WIDTH, HEIGHT = 1280, 720
COLUMN_LEFT, COLUMN_RIGHT = 744, 1264
MAP_LEFT, MAP_TOP, MAP_PX = 786, 84, 436
COUNTS_TOP, LEGEND_TOP, LEGEND_ROW_PX = 529, 566, 20
HOLD_S = 2.0  # for so long a film shows its last picture, which has the outcome
SCENES, COLUMNS = 6, 3
TILE_PX, GAP_PX, LINE_PX, TIME_PX = 400, 14, 23, 84
"""of a storyboard; the last: room for the time before a scene's counter"""
TEXT_PX, LABEL_PX = 18, 16  # large enough for a page that is printed half as wide as paper

Append = Callable[[Picture], None]  # Takes the next picture of a film, (height, width, 3) red, green, blue.


@contextmanager
def mp4_file(path: Path, width: int, height: int, pictures_per_s: float) -> Iterator[Append]:
    """What appends a picture to the film at ``path``, which is there in full or not at all.

    H.264 in yuv420p, by the ffmpeg that imageio-ffmpeg brings along. ffmpeg is run here and not by that
    library's ``write_frames``, which does not look at how it ended: a full disk would go unnoticed.

    The folder is made. Width and height are even.

    Raises:
        InputError: the place cannot be written.
        MidnetBenchError: there is no room, or ffmpeg fails.
    """
    pictures = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {pictures_per_s:g} -i -"
    # large flat areas: a quick preset already makes a small file
    coding = "-c:v libx264 -preset veryfast -crf 25 -pix_fmt yuv420p"
    # the index comes first, so that a browser can begin before it has all of it
    container = "-movflags +faststart -fflags +bitexact -f mp4"
    options = f"-y -v error {pictures} {coding} {container}".split()
    with temporary_path(path) as draft:
        # "file:", or a name such as -x would be an option, and one with a colon another protocol
        command = [imageio_ffmpeg.get_ffmpeg_exe(), *options, f"file:{draft}"]
        ffmpeg = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)
        to_ffmpeg = ffmpeg.stdin
        assert to_ffmpeg is not None

        def failure(messages: bytes) -> MidnetBenchError:
            lines = [line.strip() for line in messages.decode(errors="replace").splitlines() if line.strip()]
            return MidnetBenchError(f"{path}: cannot be written: {lines[-1] if lines else 'ffmpeg ended'}")

        def append(picture: Picture) -> None:
            try:
                to_ffmpeg.write(np.ascontiguousarray(picture).data)
            except OSError as error:
                raise failure(ffmpeg.communicate()[1]) from error

        try:
            yield append
        except BaseException:
            ffmpeg.kill()
            ffmpeg.communicate()
            raise
        _, messages = ffmpeg.communicate()
        if ffmpeg.returncode:
            raise failure(messages)


@contextmanager
def trial_video(setup: Setup, directory: Path, speed: float) -> Iterator[Callable[[Scene], None]]:
    """What appends a scene to ``trial.mp4`` and ``storyboard.png``, which are there once the context ends.

    The film runs ``speed`` times as fast as the trial. Raises what :func:`mp4_file` does.
    """
    painter, storyboard, rate = ScenePainter(setup, speed), Storyboard(setup), setup.frame_hz * speed
    with mp4_file(directory / "trial.mp4", WIDTH, HEIGHT, rate) as append_picture:
        last: list[Picture] = []

        def append(scene: Scene) -> None:
            last[:] = [painter.paint(scene)]
            append_picture(last[0])
            storyboard.offer(scene)

        yield append
        for picture in last * round(HOLD_S * rate):
            append_picture(picture)
    write_atomically(directory / "storyboard.png", png_of(storyboard.page()))


class ScenePainter:
    """Paints the true world beside what MIDNet makes of it. What never moves is painted once."""

    def __init__(self, setup: Setup, speed: float) -> None:
        """``speed``: how much faster than the trial's own time the film runs."""
        self._world, self._detections = WorldPanel(setup, HEIGHT), DetectionPanel(setup)
        self._page = page = blank_page(WIDTH, HEIGHT)
        intruders = setup.mobile_intruders + setup.other_intruders + len(setup.plan.stationary)
        guards = f"{setup.guards} guard{'s' * (setup.guards != 1)}"
        team = f"{guards}, {intruders} intruder{'s' * (intruders != 1)}"
        enlarged = self._world.enlarged
        size = f"; robots drawn {enlarged:.1f} times their size" if enlarged > 1.0 else ""
        write(page, COLUMN_LEFT, 10, setup.plan.title, 20, bold=True)
        write(page, COLUMN_LEFT, 38, f"{team}; {speed:g} x real time{size}", 14)
        write(page, MAP_LEFT, MAP_TOP - 20, "what MIDNet sees, on the prior map", 13, FAINT_INK)
        detections = [*detection_legend(numbered=True), *grid_legend()]
        for left, entries in ((COLUMN_LEFT + 8, world_legend(setup)), (COLUMN_LEFT + 254, detections)):
            write_legend(page, entries, left, LEGEND_TOP, LEGEND_ROW_PX, 13)

    def paint(self, scene: Scene) -> Picture:
        """(720, 1280, 3) the trial at the scene's instant."""
        picture = self._page.copy()
        self._world.paint(picture[:, :HEIGHT], scene)
        self._detections.paint(picture[MAP_TOP : MAP_TOP + MAP_PX, MAP_LEFT : MAP_LEFT + MAP_PX], scene)
        write(picture, COLUMN_RIGHT, 8, f"{scene.time_s:.1f} s", 24, bold=True, before=1.0)
        write(picture, COLUMN_LEFT + 8, COUNTS_TOP, scene.counter, 14, bold=True)
        write(picture, COLUMN_RIGHT, COUNTS_TOP, scene.remark, 14, before=1.0)
        return picture


class Storyboard:
    """A page of scenes that are evenly spread over a trial, however long it turns out to be."""

    def __init__(self, setup: Setup) -> None:
        self._setup = setup
        self._world = WorldPanel(setup, TILE_PX, label_px=LABEL_PX)
        self._scenes: list[Scene] = []
        self._turns: list[Scene] = []
        """the scenes with something new in their remark, of a trial that is about catching"""
        self._last: Scene | None = None
        self._every, self._offered = 1, 0

    def offer(self, scene: Scene) -> None:
        """The next frame; most are not kept."""
        scene = replace(scene, explanation=None)  # grids would fill the memory
        if scene.chase and scene.remark and (self._last is None or self._last.remark != scene.remark):
            self._turns.append(scene)
        if self._offered % self._every == 0:
            self._scenes.append(scene)
            # never more than four times what will be shown
            if len(self._scenes) > 4 * SCENES:
                self._scenes, self._every = self._scenes[::2], 2 * self._every
        self._last = scene
        self._offered += 1

    def chosen(self) -> list[Scene]:
        """The first frame, the last one, the last catches and escapes, and others at even distances."""
        if self._last is None:
            return []
        kept = {scene.frame: scene for scene in [*self._scenes, self._last]}
        frames = sorted(kept)
        even = np.linspace(0, len(frames) - 1, min(SCENES, len(frames))).round().astype(int).tolist()
        chosen = {scene.frame: scene for scene in [self._last, *self._turns[1 - SCENES :]]}
        # from both ends inwards: the first and the last scene tell the most
        for place in sorted(even, key=lambda place: min(place, len(frames) - 1 - place)):
            if len(chosen) < SCENES:
                chosen[frames[place]] = kept[frames[place]]
        return [chosen[frame] for frame in sorted(chosen)]

    def page(self) -> Picture:
        """(height, width, 3) the chosen scenes in reading order."""
        chosen = self.chosen()
        step = TILE_PX + GAP_PX
        width = COLUMNS * step + GAP_PX
        entries = [*world_legend(self._setup, chosen), *detection_legend(chosen)]
        rows = 1 + max((row for _, row in legend_rows(entries, GAP_PX, width, 16)), default=0)
        head_px = 44 + LINE_PX * rows + 4
        caption_px = LINE_PX * (2 if any(scene.remark for scene in chosen) else 1) + 4
        page = blank_page(width, head_px + -(-len(chosen) // COLUMNS) * (step + caption_px))
        write(page, GAP_PX, 8, self._setup.plan.title, 22, bold=True)
        write_legend(page, entries, GAP_PX, 44 + 10, LINE_PX, 16, right=width)
        places = tiles(len(chosen), COLUMNS, step, step + caption_px, GAP_PX, head_px)
        remark = ""
        for scene, (left, top) in zip(chosen, places, strict=True):
            write(page, left, top, f"{scene.time_s:.1f} s", TEXT_PX, bold=True)
            write(page, left + TIME_PX, top, scene.counter, TEXT_PX)
            if scene.chase is None or scene.remark != remark:  # a catch is written once
                remark = scene.remark
                write(page, left, top + LINE_PX, remark, 16)
            top += caption_px
            self._world.paint(page[top : top + TILE_PX, left : left + TILE_PX], scene)
        return page
