"""``render_trial``: the pictures of one trial, and a video of it."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from pathlib import Path

from midnet_bench.campaign.trial import Scalar
from midnet_bench.drawing.films import trial_video
from midnet_bench.drawing.painter import png_of
from midnet_bench.drawing.scene import Scene, Setup
from midnet_bench.drawing.stills import draw_arena, draw_detections, draw_grids
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.io.files import write_atomically

DEFAULT_FRAME = 100
MAX_SPEED = 12.0  # 60 pictures a second, more than that no browser shows.

Progress = Callable[[int, int], None]
"""Called after each frame: how many are done, how many there are at most."""


def render_trial(
    experiment: str,
    parameters: Mapping[str, Scalar],
    seed: int,
    directory: str | Path,
    frame_number: int | None = None,
    clip: bool = True,
    progress: Progress = lambda done, most: None,
    speed: float = 2.0,
    scans: bool = False,
) -> list[Path]:
    """The files written: ``arena.png``, ``grids.png``, ``detections.png``; ``trial.mp4``, ``storyboard.png``.

    The three pictures show one frame; the video, and six of its scenes on one page, the whole trial. The
    same trial gives the same PNG bytes. A detector that does not explain its frames gets no ``grids.png``.

    Args:
        experiment: its name, or a reference to it; it must have guards to draw.
        parameters: those that are not to have their default.
        seed: the trial's.
        directory: made if it is not there.
        frame_number: of the frame to draw, counted from 1 (5 frames per simulated second); None for frame
            100, or the last of a shorter trial.
        clip: whether to make a video; without one the trial ends after the frame that is drawn.
        progress: called after each frame.
        speed: how much faster than the trial's own time the video runs.
        scans: whether pictures show the returns of the guards' LiDARs.

    Raises:
        InputError: the experiment is unknown or cannot be drawn, a parameter is wrong, the trial has no such
            frame, or the folder cannot be made.
        MidnetBenchError: there is no room, or ffmpeg fails.
    """
    found, directory = registry.experiment(experiment), Path(directory)
    if found.trials.demo is None:
        raise InputError(f"render: '{experiment}' has no guards; 'midnet-bench map ARENA' draws explorations")
    if not 0.0 < speed <= MAX_SPEED:
        raise InputError(f"speed: {speed:g} is out of range; allowed: above 0, at most {MAX_SPEED:g}")
    with found.trials.demo(found.parameters.parse(parameters, experiment), seed) as demo:
        chosen = min(DEFAULT_FRAME, demo.max_frames) if frame_number is None else frame_number
        if not 1 <= chosen <= demo.max_frames:
            raise InputError(f"frame: {chosen} is out of range; the trial has frames 1 to {demo.max_frames}")
        _make_folder(directory)
        setup = replace(demo.setup, shows_scans=scans)
        written: list[Path] = []
        last: Scene | None = None
        video: AbstractContextManager[Callable[[Scene], None] | None] = nullcontext()
        if clip:
            video = trial_video(setup, directory, speed)
        with video as append:
            for number, last in enumerate(demo.scenes, 1):
                if number == chosen:
                    written += _write_pictures(setup, last, directory)
                    if append is None:
                        break
                if append is not None:
                    append(last)
                progress(number, demo.max_frames)
        if not written and frame_number is None and last is not None:
            written += _write_pictures(setup, last, directory)
    if not written:
        ended = 0 if last is None else last.frame
        raise InputError(f"frame: {chosen} is out of range; this trial ended with frame {ended}")
    return written + ([directory / "trial.mp4", directory / "storyboard.png"] if clip else [])


def _make_folder(directory: Path) -> None:
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: cannot be made: {error.strerror}") from error


def _write_pictures(setup: Setup, scene: Scene, directory: Path) -> list[Path]:
    pictures = {"arena.png": draw_arena(setup, scene)}
    if scene.explanation is not None:
        pictures["grids.png"] = draw_grids(setup, scene, scene.explanation)
    pictures["detections.png"] = draw_detections(setup, scene)
    for name, picture in pictures.items():
        write_atomically(directory / name, png_of(picture))
    return [directory / name for name in pictures]
