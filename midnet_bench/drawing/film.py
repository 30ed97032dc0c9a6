"""``Film``: a trial's MP4 and its storyboard, written frame by frame."""

from pathlib import Path
from types import TracebackType
from typing import Self

import cv2

from midnet_bench.drawing.clip import HEIGHT, WIDTH, Clip
from midnet_bench.drawing.scene import Scene
from midnet_bench.drawing.storyboard import Storyboard
from midnet_bench.drawing.video import VideoFile
from midnet_bench.experiments.guarded.arena import FRAME_HZ, GuardedArena
from midnet_bench.io.files import write_atomically
from midnet_bench.midnet.pipeline import Explanation


class Film:
    """``trial.mp4`` and ``storyboard.png`` in a folder, there once the context ends without an error."""

    def __init__(self, trial: GuardedArena, directory: Path, speed: float) -> None:
        """``speed``: how much faster than the trial's own time the clip runs."""
        self.paths = [directory / "trial.mp4", directory / "storyboard.png"]
        self._clip = Clip(trial, speed)
        self._storyboard = Storyboard(trial)
        self._video = VideoFile(self.paths[0], WIDTH, HEIGHT, FRAME_HZ * speed)

    def __enter__(self) -> Self:
        return self

    def append(self, scene: Scene, explanation: Explanation) -> None:
        """The trial at its next frame."""
        self._video.append(self._clip.paint(scene, explanation))
        self._storyboard.offer(scene)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._video.__exit__(kind, error, trace)
        if error is None:
            _, png = cv2.imencode(".png", self._storyboard.page()[..., ::-1])
            write_atomically(self.paths[1], png.tobytes())
