"""A detection trial for ``midnet-bench render``."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from midnet_bench.drawing.scene import Demo, Scene
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.guarded.scenes import scene_of, setup_of
from midnet_bench.scoring.frame_counts import NOTHING, ratios, total


@contextmanager
def demo(parameters: DetectionParameters, seed: int) -> Iterator[Demo]:
    """The trial of that seed, scene by scene."""
    with DetectionTrial(parameters, seed) as trial:
        yield Demo(setup_of(trial), parameters.frames, _scenes(trial))


def _scenes(trial: DetectionTrial) -> Iterator[Scene]:
    summed = NOTHING
    for scored in trial.frames(explain=True):
        summed = total([summed, scored.counts])
        scene = scene_of(trial, scored)
        yield replace(scene, so_far=ratios(summed.tp, summed.fp, summed.fn))
