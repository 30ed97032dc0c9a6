"""``export_trial``: a trial as a bag that ROS tools and viewers open, and ``replay`` detects on again."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from midnet_bench.agents.mobile_robot import Guard, MobileRobot
from midnet_bench.analysis.frames import load_results
from midnet_bench.drawing.palette import INTRUDER
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena
from midnet_bench.experiments.guarded.parameters import FRAME_HZ, GuardParameters
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.io.files import write_atomically
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.recording.files import ros_messages as ros
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.files.ros_messages import MAP, Marked, ros_name, write_layout
from midnet_bench.recording.files.writer import BagWriter, bag_writer
from midnet_bench.recording.setup import RecordingSetup
from midnet_bench.scoring.frame_counts import TruthObject
from midnet_bench.settings import Scalar, leaves
from midnet_bench.workflows.errors import narrowed
from midnet_bench.workflows.render import Progress

SETUP_ENDING = ".setup.yaml"
START_NS = 1  # stamp of what is there before the first tick: ROS takes 0 for no time at all
DETECTORS_OWN = ("prior", "costmap", "midnet")
DETECTORS_KEYS = ("detector", "fusion", "robot", "resolution_m", "deflate_boxes")
"""groups and keys of the parameters that decide what a ``DetectorNode`` makes of scans and poses"""


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
    numbers are those that it has without. Beside the bag lie a layout for Foxglove, and ``NAME.setup.yaml``,
    by which ``replay`` detects on it as the trial did.

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
    trial: Any = None if found.trials.frames is None else found.trials.frames(checked, seed)
    has_guards = isinstance(trial, GuardedArena)
    if not has_guards:
        raise InputError(f"export: '{experiment}' has no guards; detection and labyrinth have")
    # a labyrinth trial may end before; a last frame that its time limit falls into is made in full
    most = checked.flat_values().get("frames")
    if not isinstance(most, int):
        most = math.ceil(float(str(checked.flat_values()["time_limit_s"])) * FRAME_HZ - 1e-6)
    done, path = 0, Path(path)
    with trial, bag_writer(path, bag_format) as bag:
        exporter = Exporter(trial, trial.truths, bag)
        for _ in trial.frames(explain=True):
            done += 1
            progress(done, most)
        kinds = bag.kinds
    write_layout(path, kinds, Box(*trial.prior_map.extent))
    setup = exporter.replay_setup([topic for topic in kinds if topic.startswith("/truth/")])
    write_atomically(setup_beside(path), setup.to_yaml(path.parent))
    return done


def setup_beside(path: Path) -> Path:
    """The setup by which ``replay`` detects on an exported trial as the trial did."""
    return path.with_name(path.stem + SETUP_ENDING)


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


def detector_values(parameters: GuardParameters) -> dict[str, Scalar]:
    """The value of each option, by flat key, that decides what the detector makes of scans and poses."""
    values = parameters.flat_values()
    return {
        key: values[key]
        for key, leaf in leaves(type(parameters)).items()
        if leaf.path[0] in DETECTORS_OWN or key in DETECTORS_KEYS
    }


class Exporter:
    """Writes a trial in motion into a bag and changes nothing in the trial."""

    def __init__(
        self, trial: GuardedArena, truths: Callable[[], Sequence[TruthObject]], bag: BagWriter
    ) -> None:
        """Of a trial that has not begun; ``truths``: gives its intruders as they are then.

        Raises:
            InputError: an oracle or a network decides what MIDNet receives, which no robot sends.
        """
        parameters = trial.parameters
        if parameters.oracle != "none":
            raise InputError(
                f"oracle: {parameters.oracle} gives MIDNet what no robot sends; take oracle=none"
            )
        if parameters.network.is_used:
            raise InputError(
                "export: a network (message_delay_s and its like) decides what MIDNet receives; leave it out"
            )
        self._trial, self._truths, self._bag = trial, truths, bag
        self._names = [ros_name(guard.name) for guard in trial.guards]
        self._scan_period_s = 1.0 / min(parameters.simulation.lidar.hz, trial.step_hz)
        self._begin()
        trial.tick_callbacks.append(self._stepped)
        trial.frame_callbacks.append(self._detected)

    @property
    def _now_ns(self) -> int:
        return self._trial.world.tick * NS // self._trial.step_hz

    def _begin(self) -> None:
        trial, bag = self._trial, self._bag
        mount = trial.robot.lidar.mount
        bag.write("/map", START_NS, ros.occupancy_grid(START_NS, trial.prior_map), is_kept=True)
        mounted = [(f"{name}/base_footprint", f"{name}/base_scan", mount) for name in self._names]
        bag.write("/tf_static", START_NS, ros.transforms(START_NS, mounted), is_kept=True)
        for guard in trial.guards:
            self._write_pose(guard, START_NS)

    def replay_setup(self, topics: Sequence[str]) -> RecordingSetup:
        """How ``replay`` makes the trial's frames of the bag; labels are the poses among ``topics``."""
        poses = {topic.split("/")[2]: topic for topic in topics if topic.endswith("/pose")}
        return RecordingSetup().changed(
            {
                "map": "/map",
                "scan": {name: f"/{name}/scan" for name in self._names},
                "pose": {name: f"/{name}/pose" for name in self._names},
                "no_return": {"nan": "nothing", "zero": "nothing"},
                "rate_hz": FRAME_HZ,
                "truth": poses,
                "preset": "paper",
                "settings": detector_values(self._trial.parameters),
            },
            "export",
        )

    def _stepped(self, due: Sequence[MobileRobot]) -> None:
        """A tick is over, at which the robots ``due`` have localised and some of them have scanned."""
        stamp_ns, time_s = self._now_ns, self._trial.fleet.time_s
        for robot in due:
            if isinstance(robot, Guard):
                self._write_pose(robot, stamp_ns)
                if robot.scan is not None and robot.scan.stamp_s == time_s:
                    self._write_scan(robot, stamp_ns)

    def _write_pose(self, guard: Guard, stamp_ns: int) -> None:
        bag, name, pose = self._bag, self._names[guard.index], guard.pose
        odom, base = f"{name}/odom", f"{name}/base_footprint"
        driven = self._trial.fleet.odometry_pose(guard)
        placed = [(MAP, odom, pose.compose(driven.inverse())), (odom, base, driven)]
        bag.write(f"/{name}/pose", stamp_ns, ros.pose_stamped(stamp_ns, pose))
        bag.write("/tf", stamp_ns, ros.transforms(stamp_ns, placed))
        bag.write(
            f"/{name}/odom", stamp_ns, ros.odometry(stamp_ns, base, driven, *guard.velocity, frame=odom)
        )

    def _write_scan(self, guard: Guard, stamp_ns: int) -> None:
        assert guard.scan is not None
        bag, name, (ranges_m, lidar, *_) = self._bag, self._names[guard.index], guard.scan
        scan = ros.laser_scan(f"{name}/base_scan", stamp_ns, ranges_m, lidar, self._scan_period_s)
        bag.write(f"/{name}/scan", stamp_ns, scan)

    def _detected(self, frame: Frame) -> None:
        """MIDNet has made a frame."""
        trial, bag, stamp_ns = self._trial, self._bag, self._now_ns
        for name, observation in zip(self._names, trial.observations(trial.detector), strict=True):
            bag.write(f"/{name}/costmap", stamp_ns, ros.occupancy_grid(stamp_ns, observation.costmap))
        for topic, message in ros.frame_messages(stamp_ns, frame, self._names, bag.ros):
            bag.write(topic, stamp_ns, message)
        self._write_truth(stamp_ns)

    def _write_truth(self, stamp_ns: int) -> None:
        trial, truths = self._trial, self._truths()
        poses = trial.world.poses()
        headings = {robot.name: float(poses[robot.index, 2]) for robot in trial.intruders}
        headings |= {member.name: member.pose.yaw for member in trial.crowd.members}
        marked = [Marked(truth.box, ros_name(truth.name), INTRUDER, truth.name) for truth in truths]
        self._bag.write("/truth/markers", stamp_ns, ros.markers(stamp_ns, marked))
        for truth in truths:
            pose = Pose2D(*truth.center, headings.get(truth.name, 0.0))
            self._bag.write(f"/truth/{ros_name(truth.name)}/pose", stamp_ns, ros.pose_stamped(stamp_ns, pose))
