"""A detection trial for ``midnet-bench render``."""

from collections.abc import Iterator
from contextlib import contextmanager

from midnet_bench.drawing.scene import Demo
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.guarded.scenes import scene_of, setup_of


@contextmanager
def demo(parameters: DetectionParameters, seed: int) -> Iterator[Demo]:
    """The trial of that seed, scene by scene."""
    with DetectionTrial(parameters, seed) as trial:
        scenes = (scene_of(trial, scored.midnet) for scored in trial.frames(explain=True))
        yield Demo(setup_of(trial), parameters.frames, scenes)
