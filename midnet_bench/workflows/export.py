"""``export_trial``: a trial as a bag that ROS tools and viewers open, and ``replay`` detects on again."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from midnet_bench.analysis.frames import load_results
from midnet_bench.campaign.trial import Scalar
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.experiments.guarded.exporter import Exporter
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.geometry import Box
from midnet_bench.recording.files.ros_messages import write_layout
from midnet_bench.recording.files.writer import bag_writer
from midnet_bench.workflows.errors import narrowed
from midnet_bench.workflows.render import Progress


def export_trial(
    experiment: str,
    parameters: Mapping[str, Scalar],
    seed: int,
    path: str | Path,
    bag_format: str = "mcap",
    progress: Progress = lambda done, most: None,
) -> int:
    """How many frames were written: the trial runs, and all that robots and detector say goes into a bag.

    Topics, types and frames are those of ``docs/ros.md``; stamps are the trial's own time. The trial's
    numbers are those that it has without. A layout for Foxglove lies beside the bag.

    Args:
        experiment: its name, or a reference to it; it must have guards.
        parameters: those that are not to have their default.
        seed: the trial's.
        path: a file; of ``ros2`` a folder, which must not be there.
        bag_format: ``mcap``, ``ros2`` (a folder with an SQLite file) or ``ros1``.
        progress: called after each frame.

    Raises:
        InputError: the experiment or the format is unknown, a parameter is wrong, an oracle or a network
            is between robots and detector, or the place cannot be written.
        MidnetBenchError: the disk is full.
    """
    found = registry.experiment(experiment)
    # what is kept and measured of a trial has no place in a bag
    given = {key: value for key, value in parameters.items() if key not in ("record", "metrics")}
    checked = found.parameters.parse(given, f"export: {experiment}")
    trial: Any = None if found.trial is None else found.trial(checked, seed)
    has_guards = isinstance(trial, GuardedArena)
    if not has_guards:
        raise InputError(f"export: '{experiment}' has no guards; detection and labyrinth have")
    # a labyrinth trial may end before; a last frame that its time limit falls into is made in full
    most = checked.flat_values().get("frames")
    if not isinstance(most, int):
        most = math.ceil(float(str(checked.flat_values()["time_limit_s"])) * FRAME_HZ - 1e-6)
    done, path = 0, Path(path)
    with trial, bag_writer(path, bag_format) as bag:
        Exporter(trial, trial.truths, bag)
        for _ in trial.frames(explain=True):
            done += 1
            progress(done, most)
        kinds = bag.kinds
    write_layout(path, kinds, Box(*trial.prior_map.extent))
    return done


def trial_of(
    directory: str | Path, seed: int | None, where: Sequence[str]
) -> tuple[str, dict[str, Scalar], int]:
    """The experiment, the parameters and the seed of one of a campaign's trials, for :func:`export_trial`.

    Args:
        directory: of the campaign.
        seed: one of the campaign's; None for its only one.
        where: ``FACTOR=VALUE`` of the grid, as many as it takes to name one cell.

    Raises:
        InputError: there is no such campaign, cell or seed, or several cells or seeds match.
    """
    whole = load_results(Path(directory), registry.tables_of)
    definition = narrowed(whole, where).definition
    if several := [factor for factor, values in definition.grid.items() if len(values) > 1]:
        raise InputError(f"{directory}: name one value of {', '.join(several)} by --where")
    parameters = definition.parameters_of({factor: values[0] for factor, values in definition.grid.items()})
    last = definition.base_seed + definition.trials - 1
    if seed is None and definition.trials > 1:
        raise InputError(f"{directory} has seeds {definition.base_seed} to {last}; name one by --seed")
    seed = definition.base_seed if seed is None else seed
    if not definition.base_seed <= seed <= last:
        raise InputError(f"seed: {seed} is none of {directory}, which has {definition.base_seed} to {last}")
    return definition.reference(Path(directory)), parameters, seed
