"""``VideoFile``: pictures in, an MP4 out that every browser plays."""

import os
import subprocess
from pathlib import Path
from types import TracebackType
from typing import Self

import imageio_ffmpeg
import numpy as np

from midnet_bench.drawing.canvas import Picture
from midnet_bench.errors import MidnetBenchError


class VideoFile:
    """H.264 in yuv420p, written by the ffmpeg that imageio-ffmpeg brings along. A context manager.

    The file is there in full or not at all. ffmpeg is run here and not by that library's ``write_frames``,
    which does not look at how it ended: a full disk would go unnoticed.

    Raises:
        MidnetBenchError: ffmpeg cannot write the file.
    """

    def __init__(self, path: Path, width: int, height: int, pictures_per_s: float) -> None:
        """``width`` and ``height`` in pixels, even."""
        self._path = path
        self._draft = path.with_name(f".{path.name}.new")
        pictures = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {pictures_per_s:g} -i -"
        # large flat areas: a quick preset already makes a small file
        coding = "-c:v libx264 -preset veryfast -crf 25 -pix_fmt yuv420p"
        # the index comes first, so that a browser can begin before it has all of it
        container = "-movflags +faststart -fflags +bitexact -f mp4"
        options = f"-y -v error {pictures} {coding} {container}".split()
        self._process = subprocess.Popen(
            [imageio_ffmpeg.get_ffmpeg_exe(), *options, str(self._draft)],
            stdin=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    def __enter__(self) -> Self:
        return self

    def append(self, picture: Picture) -> None:
        """The next picture, (height, width, 3) red, green, blue."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(picture).data)
        except OSError as error:
            raise self._failure(self._process.communicate()[1]) from error

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is not None:
                self._process.kill()
                self._process.communicate()
                return
            said = self._process.communicate()[1]
            if self._process.returncode:
                raise self._failure(said)
            os.replace(self._draft, self._path)
        finally:
            self._draft.unlink(missing_ok=True)

    def _failure(self, said: bytes) -> MidnetBenchError:
        lines = [line.strip() for line in said.decode(errors="replace").splitlines() if line.strip()]
        return MidnetBenchError(f"{self._path}: cannot be written: {lines[-1] if lines else 'ffmpeg ended'}")
