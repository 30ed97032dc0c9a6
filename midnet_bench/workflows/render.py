"""``render_trial``: the pictures of one trial, and a clip of it."""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import nullcontext
from pathlib import Path

from pydantic import BaseModel

from midnet_bench.campaign.trial import Scalar
from midnet_bench.drawing.arena_view import draw_arena
from midnet_bench.drawing.film import Film
from midnet_bench.drawing.grid_view import draw_detections, draw_grids
from midnet_bench.drawing.plots import png_of
from midnet_bench.drawing.scene import scene_of
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.guarded.arena import FRAME_HZ
from midnet_bench.experiments.guarded.parameters import (
    DetectionParameters,
    GuardParameters,
    LabyrinthParameters,
)
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial
from midnet_bench.experiments.registry import parameters_model
from midnet_bench.io.checked_yaml import parse
from midnet_bench.io.files import write_atomically
from midnet_bench.midnet.pipeline import Frame

USUAL_FRAME = 100
MOST_SPEED = 12.0
"""60 pictures a second, more than that no browser shows."""

Progress = Callable[[int, int], None]
"""Called after each frame: how many are done, how many there are at most."""
Trial = DetectionTrial | LabyrinthTrial


def render_trial(
    experiment: str,
    parameters: Mapping[str, Scalar],
    seed: int,
    directory: Path,
    frame_number: int | None = None,
    clip: bool = True,
    progress: Progress = lambda done, most: None,
    speed: float = 2.0,
) -> list[Path]:
    """The files written: ``arena.png``, ``grids.png``, ``detections.png``; ``trial.mp4``, ``storyboard.png``.

    The three pictures show one frame; the clip, and its dozen moments on one page, the whole trial. The
    same trial gives the same PNG bytes.

    Args:
        experiment: ``detection`` or ``labyrinth``.
        parameters: those that are not to have their default.
        seed: the trial's.
        directory: made if it is not there.
        frame_number: of the frame to draw, counted from 1 (5 frames per simulated second); None for frame
            100, or the last of a shorter trial.
        clip: whether to make a clip; without one the trial ends after the frame that is drawn.
        progress: told after each frame.
        speed: how much faster than the trial's own time the clip runs.

    Raises:
        InputError: a parameter is wrong, the trial has no such frame, or the folder cannot be made.
        MidnetBenchError: a file cannot be written.
    """
    if not issubclass(parameters_model(experiment), GuardParameters):
        raise InputError(f"render: '{experiment}' has no guards; 'midnet-bench map ARENA' draws explorations")
    model = parse(parameters_model(experiment), dict(parameters), experiment)
    most = _frames_at_most(model)
    drawn = min(USUAL_FRAME, most) if frame_number is None else frame_number
    if not 1 <= drawn <= most:
        raise InputError(f"frame: {drawn} is out of range; the trial has frames 1 to {most}")
    if not 0.0 < speed <= MOST_SPEED:
        raise InputError(f"speed: {speed:g} is out of range; allowed: above 0, at most {MOST_SPEED:g}")
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{directory}: cannot be made: {error.strerror}") from error

    written: list[Path] = []
    number = 0
    with _trial(model, seed) as trial, Film(trial, directory, speed) if clip else nullcontext() as film:
        for number, frame in enumerate(_frames(trial), 1):
            if number == drawn:
                written += _write_pictures(trial, frame, directory)
                if film is None:
                    break
            if film is not None:
                assert frame.explanation is not None
                film.append(scene_of(trial, frame), frame.explanation)
            progress(number, most)
        if not written and frame_number is None:
            written += _write_pictures(trial, frame, directory)
    if not written:
        raise InputError(f"frame: {frame_number} is out of range; this trial ended with frame {number}")
    return written + (film.paths if film is not None else [])


def _trial(parameters: BaseModel, seed: int) -> Trial:
    if isinstance(parameters, DetectionParameters):
        return DetectionTrial(parameters, seed)
    assert isinstance(parameters, LabyrinthParameters)
    return LabyrinthTrial(parameters, seed)


def _frames(trial: Trial) -> Iterator[Frame]:
    if isinstance(trial, DetectionTrial):
        return (scored.midnet for scored in trial.frames(explain=True))
    return trial.frames(explain=True)


def _frames_at_most(parameters: BaseModel) -> int:
    if isinstance(parameters, DetectionParameters):
        return parameters.frames
    assert isinstance(parameters, LabyrinthParameters)
    # a last frame that the time limit falls into is made in full
    return math.ceil(parameters.time_limit_s * FRAME_HZ - 1e-6)


def _write_pictures(trial: Trial, frame: Frame, directory: Path) -> list[Path]:
    assert frame.explanation is not None
    scene = scene_of(trial, frame)
    figures = {
        "arena.png": draw_arena(trial, scene),
        "grids.png": draw_grids(trial, scene, frame.explanation),
        "detections.png": draw_detections(trial, scene),
    }
    for name, figure in figures.items():
        write_atomically(directory / name, png_of(figure))
    return [directory / name for name in figures]
