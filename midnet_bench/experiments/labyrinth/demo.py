"""A labyrinth trial for ``midnet-bench render``."""

import math
from collections.abc import Iterator
from contextlib import contextmanager

from midnet_bench.drawing.scene import Demo
from midnet_bench.experiments.guarded.arena import FRAME_HZ
from midnet_bench.experiments.guarded.scenes import scene_of, setup_of
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial


@contextmanager
def demo(parameters: LabyrinthParameters, seed: int) -> Iterator[Demo]:
    """The trial of that seed, scene by scene, until nobody is at large or the time is up."""
    with LabyrinthTrial(parameters, seed) as trial:
        # a last frame that the time limit falls into is made in full
        max_frames = math.ceil(parameters.time_limit_s * FRAME_HZ - 1e-6)
        scenes = (scene_of(trial, frame) for frame in trial.frames(explain=True))
        yield Demo(setup_of(trial), max_frames, scenes)
