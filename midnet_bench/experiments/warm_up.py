"""Compile once, before worker processes start: they then find numba's cache filled."""

from itertools import islice

import numpy as np

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.experiments.mapping.trial import ExplorationTrial
from midnet_bench.navigation.navigator import compile_kernels as compile_navigation
from midnet_bench.simulation.crowd import Crowd

EXPLORED_S = 5
"""long enough for a robot to match a few scans and to plan on its map"""


def compile_kernels() -> None:
    """Run every compiled loop once; about half a minute without a cache."""
    compile_navigation()
    for engine in ("fast", "bullet"):
        parameters = DetectionParameters.of(
            odometry="encoder", localization="ukf+map", frames=5, engine=engine
        )
        with DetectionTrial(parameters, seed=1) as detection:
            for _ in detection.frames():
                pass
    Crowd(place(load_arena("people"), 1, 1), 1.0).step(np.empty((0, 3)))
    with ExplorationTrial(MappingParameters(), seed=1) as exploration:
        for _ in islice(exploration.snapshots(), EXPLORED_S):
            pass
