"""A labyrinth trial for ``midnet-bench render``."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from midnet_bench.drawing.scene import Chase, Demo, Scene
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.experiments.guarded.scenes import scene_of, setup_of
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial


@contextmanager
def demo(parameters: LabyrinthParameters, seed: int) -> Iterator[Demo]:
    """The trial of that seed, scene by scene, until no intruder is at large or the time is up."""
    with LabyrinthTrial(parameters, seed) as trial:
        # a last frame that the time limit falls into is made in full
        max_frames = math.ceil(parameters.time_limit_s * FRAME_HZ - 1e-6)
        yield Demo(setup_of(trial), max_frames, _scenes(trial))


def _scenes(trial: LabyrinthTrial) -> Iterator[Scene]:
    """Each frame with the intruders that leave after it, and the outcomes so far."""
    seen: list[Scene] = []
    trial.frame_callbacks.append(lambda frame: seen.append(scene_of(trial, trial.scored(frame))))
    for _ in trial.frames(explain=True):
        yield replace(seen.pop(), chase=_chase(trial))


def _chase(trial: LabyrinthTrial) -> Chase:
    outcomes = [trial.outcomes[robot.index] for robot in trial.intruders]
    events: list[tuple[float, str]] = []
    for number, outcome in enumerate(outcomes, 1):
        name = f"intruder {number} " if len(outcomes) > 1 else ""
        if outcome.caught_by is not None:
            by = outcome.caught_by.index + 1
            events.append((outcome.caught_at_s, f"{name}caught by guard {by}, {outcome.caught_at_s:.1f} s"))
        elif outcome.result == "escaped":
            events.append((outcome.escaped_at_s, f"{name}escaped, {outcome.escaped_at_s:.1f} s"))
    results = [outcome.result for outcome in outcomes]
    lines = tuple(text for _, text in sorted(events))
    return Chase(len(outcomes), results.count("caught"), results.count("escaped"), lines)
