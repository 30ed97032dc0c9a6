"""``mp4_file``: pictures in, an MP4 out that every browser plays."""

import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from midnet_bench.drawing.canvas import Picture
from midnet_bench.errors import MidnetBenchError
from midnet_bench.io.files import temporary_path

Append = Callable[[Picture], None]
"""Takes the next picture of a video, (height, width, 3) red, green, blue."""


@contextmanager
def mp4_file(path: Path, width: int, height: int, pictures_per_s: float) -> Iterator[Append]:
    """What appends a picture to the video at ``path``, which is there in full or not at all.

    H.264 in yuv420p, by the ffmpeg that imageio-ffmpeg brings along. ffmpeg is run here and not by that
    library's ``write_frames``, which does not look at how it ended: a full disk would go unnoticed.

    Args:
        path: its folder is made.
        width: pixels, even.
        height: pixels, even.
        pictures_per_s: may be a fraction.

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

        def append(picture: Picture) -> None:
            try:
                to_ffmpeg.write(np.ascontiguousarray(picture).data)
            except OSError as error:
                raise _failure(path, ffmpeg.communicate()[1]) from error

        try:
            yield append
        except BaseException:
            ffmpeg.kill()
            ffmpeg.communicate()
            raise
        said = ffmpeg.communicate()[1]
        if ffmpeg.returncode:
            raise _failure(path, said)


def _failure(path: Path, said: bytes) -> MidnetBenchError:
    lines = [line.strip() for line in said.decode(errors="replace").splitlines() if line.strip()]
    return MidnetBenchError(f"{path}: cannot be written: {lines[-1] if lines else 'ffmpeg ended'}")
