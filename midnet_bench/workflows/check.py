"""``check``: calls a plug-in as trials do, for 23 frames; its faults with file and line."""

import ast
import contextlib
import random
import statistics
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.agent_settings import PATROLS, PURSUITS
from midnet_bench.agents.mobile_robot import GuardState
from midnet_bench.agents.patrol import TeamPatrol
from midnet_bench.agents.pursuit import TargetState, TeamPursuit
from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.campaign.child import attempt
from midnet_bench.campaign.definition import parse_campaign, resolve
from midnet_bench.campaign.pool import LocalPool
from midnet_bench.detectors.detector_node import detected, fused
from midnet_bench.detectors.tracking import Tracker
from midnet_bench.elementary import directions
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.guarded.guarded_arena import ScoredFrame
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.geometry import STOP, Command, lengths
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.pipeline import Observation
from midnet_bench.plugins import DETECTORS, FUSIONS, ExtensionPoint, PluginError
from midnet_bench.robots.model import ROBOTS, RobotModel
from midnet_bench.robots.turtlebot3 import BURGER, LDS_01
from midnet_bench.scoring.metric import METRICS, MetricFrame, TrialMetrics
from midnet_bench.settings import Scalar
from midnet_bench.simulation.engine import SIMULATORS, Beams
from midnet_bench.simulation.sensors import beam_directions
from midnet_bench.simulation.world import World
from midnet_bench.simulation.world_settings import WorldSettings

TEAM, FULL_TEAM, FRAMES, WARM_UP, SEED = 4, 20, 23, 25, 3001
"""A prime number of frames: plug-ins with a period do not look repeatable."""
LIMIT_S = 60.0  # of a short trial in another process
OFF_MAP_M, LARGEST_M = 1.0, 5.0
"""A box farther off the map, or with a longer side, is in other units or another frame."""
NEAR_M = 0.5  # from where a guard is sent to the nearest point of the patrol
MAX_OFF_M, MAX_SHARE_OFF = 1e-3, 0.01  # Beams may graze a corner in one engine and pass it in another.
SLOW_MPS, SLOW_RADPS = 0.02, 0.05  # allowed error of a robot's velocity, beside a tenth of the command
SHORT: Mapping[str, Scalar] = {"engine": "fast", "robots": 3, "frames": 10}
CHASE: Mapping[str, Scalar] = {
    "engine": "fast",
    "arena": "map1",  # so small that guards see intruders at once
    "escape_distance_m": 2.0,
    "robots": 3,
    "intruders": 3,
    "time_limit_s": 15.0,
}


@dataclass(frozen=True)
class Checked:
    """The result of a check."""

    seam: str  # option that the plug-in is for
    name: str  # what was checked, with its pin
    faults: list[str]  # a line for each; empty without faults
    frame_ms: float | None
    """median time of a frame of four robots; None with faults, or where frames do not call it"""


@dataclass(frozen=True)
class Frame:
    """What plug-ins get at one frame of a recorded trial; its arrays cannot be written to."""

    observations: list[Observation]
    boxes: list[BoxArray]  # by robot, without allies
    time_s: float
    targets: Mapping[int, TargetState] = field(default_factory=dict)
    guard: int = 0  # that needs its next point
    seen: MetricFrame | None = None

    @property
    def team(self) -> list[GuardState]:
        """The guards' states; every second one is on its way to the middle."""
        poses = [one.pose for one in self.observations]
        return [GuardState((pose.x, pose.y), (0.0, 0.0) if i % 2 else None) for i, pose in enumerate(poses)]


class Recording(NamedTuple):
    """Four robots in the fast engine's Map 1."""

    frames: list[Frame]
    prior_map: OccupancyGrid
    range_m: float  # up to which an intruder has to be found
    points: npt.NDArray[np.float64]  # (n, 2) of the patrol, metres, map frame
    paper_ms: float  # median time of the paper's detector and fusion


Answers = list[npt.NDArray[np.float64]]
Call = Callable[[Frame], Answers]


class Plugin(NamedTuple):
    """How trials call the code of one seam."""

    seam: ExtensionPoint
    make: Callable[[str, Recording, int], Call] | None
    """from a pinned name, the recording and the number of guards; None: it is no code that frames call"""
    odd: Callable[[Answers, Recording], str | None] = lambda answers, recording: None
    """the fault of answers that a trial would take"""
    experiment: str = "detection"
    short_trial: Mapping[str, Scalar] = SHORT


def check(thing: str) -> Checked:
    """What is wrong with the code that ``thing`` names.

    Args:
        thing: a value of ``--detector``, ``--fusion``, ``--patrol``, ``--pursuit``, ``--metric``,
            ``--engine`` or ``--robot-model``.

    Raises:
        InputError: there is no such code, or it is for no seam.
    """
    if thing.endswith(".py"):
        raise InputError(f"{thing}: which class? {_classes_in(Path(thing))}")
    plugin = _plugin_of(thing)
    seam, name = plugin.seam, plugin.seam.pinned(thing)
    if seam.is_made_here(name):
        paper_ms = recorded().paper_ms if seam in (DETECTORS, FUSIONS) else None
        return Checked(seam.option, name, [], _engine_ms(name) if seam is SIMULATORS else paper_ms)
    run_trials, spec = _trial(plugin, next(iter(seam.own)))
    run_trials([spec])  # compiles what it needs: the time limit below is for the plug-in alone
    elsewhere, faults = _in_another_process(plugin, name)
    if faults:  # it hangs, fails or ends its process
        return Checked(seam.option, name, faults, None)
    frame_ms: float | None = None
    try:
        with _random_state_kept():
            if plugin.make is not None:
                frame_ms, faults = _frame_faults(plugin, name)
            elif seam is SIMULATORS:
                faults = list(_engine_faults(name))
                frame_ms = None if faults else _engine_ms(name)
            else:
                faults = list(_robot_faults(ROBOTS.make(name)))
    except PluginError as error:
        faults = [str(error)]
    run_trials, spec = _trial(plugin, name)
    if not faults and attempt(run_trials, [spec])[0].payload != elsewhere:
        faults = [
            seam.line_of(name)
            + "another process gets other results from the same trial: does it depend on the "
            "order of a set, an id, the clock or the environment?"
        ]
    return Checked(seam.option, name, faults, None if faults else frame_ms)


def detector_ms(name: str) -> float:
    """Median time of a frame of four robots by a pinned detector, ms; the paper's includes its fusion."""
    if DETECTORS.is_made_here(name):
        return recorded().paper_ms
    with _random_state_kept():
        return _frame_faults(PLUGINS[0], name)[0]


def _plugin_of(thing: str) -> Plugin:
    """Of the seam that has this name, else of the first whose method the class has. Raises InputError."""
    complaints = []
    for plugin in PLUGINS:
        try:
            plugin.seam.pinned(thing)
            return plugin
        except InputError as error:
            complaints.append(str(error))
    seams = [plugin.seam for plugin in PLUGINS]
    if all(f"expected {seam.wanted}" in text for seam, text in zip(seams, complaints, strict=True)):
        wanted = " or ".join(f"{seam.wanted} ({seam.option})" for seam in seams)
        raise InputError(f"{thing}: expected {wanted.replace(' or a class with a method', ',')}")
    raise InputError(complaints[0].removeprefix(f"{seams[0].option}: "))


def _classes_in(path: Path) -> str:
    """The names that a file of Python offers, without running it. Raises InputError if it cannot be read."""
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(f"{path}: cannot be read as Python: {error}") from error
    names = [node.name for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef)]
    assigned = [target for node in tree.body if isinstance(node, ast.Assign) for target in node.targets]
    names += [target.id for target in assigned if isinstance(target, ast.Name)]
    names = [name for name in names if not name.startswith("_")]
    return f"It defines {', '.join(names)}: type {path}:{names[0]}" if names else "It defines none"


def _trial(plugin: Plugin, name: str) -> tuple[Any, Any]:
    """What runs a short trial with the plug-in, and the trial's spec."""
    parameters = {**plugin.short_trial, plugin.seam.option: name}
    campaign = {"experiment": plugin.experiment, "parameters": parameters, "trials": 1, "base_seed": SEED}
    resolved = resolve(parse_campaign(campaign, "check"), registry)
    (spec,) = resolved.trials()
    return resolved.run_trials, spec


def _in_another_process(plugin: Plugin, name: str) -> tuple[bytes | None, list[str]]:
    """The tables of a short trial there, and its faults."""
    run_trials, spec = _trial(plugin, name)
    with contextlib.closing(LocalPool(1).outcomes(run_trials, iter([[spec]]), LIMIT_S)) as outcomes:
        (outcome,) = outcomes
    if outcome.failure is None:
        return outcome.payload, []
    return None, [outcome.failure.splitlines()[-1].split("PluginError: ", 1)[-1]]


def _frame_faults(plugin: Plugin, name: str) -> tuple[float, list[str]]:
    """The median time of a frame, ms, and a line for each fault."""
    recording, times_s = recorded(), []

    def run(frames: list[Frame], seed: int) -> Answers:
        random.seed(seed)
        np.random.seed(seed)  # noqa: NPY002 - the one that a plug-in may draw from
        own_map = recording.prior_map.with_data(recording.prior_map.data.copy())
        own = recording._replace(prior_map=own_map, points=recording.points.copy())
        call = plugin.make(name, own, len(frames[0].observations))  # type: ignore[misc]
        answers: Answers = []
        for frame in frames:
            begin = time.perf_counter()
            given = call(replace(frame, observations=[*frame.observations], boxes=[*frame.boxes]))
            times_s.append(time.perf_counter() - begin)
            answers += given
        return answers

    first, other, again = (run(recording.frames, seed) for seed in (1, 2, 1))
    frame_ms, faults = 1e3 * statistics.median(times_s), []
    if not _same(first, again):
        faults.append(
            "it answers otherwise the second time: does it keep state at the class, or read the clock?"
        )
    elif not _same(first, other):
        faults.append("it draws from the global random numbers: take a generator with a fixed seed")
    if fault := plugin.odd(first, recording):
        faults.append(fault)
    faults = [plugin.seam.line_of(name) + fault for fault in faults]
    for description, frame in _edges(recording.frames[-1]).items():
        try:
            run([frame], 1)
        except PluginError as error:
            faults.append(f"with {description}: {error}")
    return frame_ms, list(dict.fromkeys(faults))


def _detector(name: str, recording: Recording, guards: int) -> Call:
    made = DETECTORS.make(name, recording.prior_map, recording.range_m)
    return lambda frame: detected(made, name, frame.observations)


def _fusion(name: str, recording: Recording, guards: int) -> Call:
    made = FUSIONS.make(name)
    return lambda frame: [fused(made, name, frame.boxes, frame.time_s)]


def _patrol(name: str, recording: Recording, guards: int) -> Call:
    if not guards:  # without guards, none needs a point
        return lambda frame: []
    patrol = TeamPatrol(name, recording.points, guards, np.random.default_rng(SEED))
    return lambda frame: [np.array([patrol.next_point(frame.guard, frame.team, frame.time_s)])]


def _pursuit(name: str, recording: Recording, guards: int) -> Call:
    rule = TeamPursuit(name, recording.prior_map, np.random.default_rng(SEED))

    def call(frame: Frame) -> Answers:
        if not frame.targets:
            return []
        return [np.array(sorted(rule.pursue(frame.team, frame.targets, frame.time_s).items()), np.float64)]

    return call


def _metric(name: str, recording: Recording, guards: int) -> Call:
    metrics = TrialMetrics(name)
    return lambda frame: [np.array(list(metrics.update(frame.seen).values()))]  # type: ignore[arg-type]


def _edges(frame: Frame) -> dict[str, Frame]:
    """Frames that are rare in trials, by their description."""
    assert frame.seen is not None
    times, places, no_boxes = FULL_TEAM // TEAM, [one.place for one in frame.team], np.empty((0, 4))
    targets = {5 + i: TargetState(places[(5 + i) % TEAM], frame.time_s, ()) for i in range(FULL_TEAM)}
    unseen = [
        replace(one, scan=None, costmap=one.costmap.with_data(np.zeros_like(one.costmap.data)))
        for one in frame.observations[:1]
    ]
    blind = frame.seen._replace(boxes=no_boxes)
    peace = frame.seen._replace(truths=(), in_range=())
    full = replace(frame, observations=frame.observations * times, boxes=frame.boxes * times)
    return {
        "nobody": Frame([], [], frame.time_s, seen=peace._replace(boxes=no_boxes, guards=np.empty((0, 2)))),
        "one robot that has seen nothing": Frame(unseen, [no_boxes], frame.time_s, targets, seen=blind),
        f"{FULL_TEAM} robots": replace(full, targets={5: targets[5]}),
        "no intruders": replace(frame, seen=peace),
    }


def _odd_box(answers: Answers, recording: Recording) -> str | None:
    x_min, y_min, x_max, y_max = recording.prior_map.extent
    low, high = np.array((x_min, y_min)) - OFF_MAP_M, np.array((x_max, y_max)) + OFF_MAP_M
    for box in np.concatenate(answers):
        width, height = box[2:] - box[:2]
        if max(width, height) > LARGEST_M:
            return f"a box of {width:.3g} x {height:.3g} m: are these metres?"
        if (box[:2] < low).any() or (box[2:] > high).any():
            return (
                f"a box at ({box[0]:.3g}, {box[1]:.3g}) m is off the map, which is from ({x_min:.3g}, "
                f"{y_min:.3g}) to ({x_max:.3g}, {y_max:.3g}) m: is it in the map frame?"
            )
    return None


def _odd_point(answers: Answers, recording: Recording) -> str | None:
    for point in np.concatenate(answers):
        if lengths(recording.points - point).min() > NEAR_M:
            return (
                f"it sends a guard to ({point[0]:.3g}, {point[1]:.3g}) m, which is near no point of the "
                "patrol: return one of the points that the constructor got"
            )
    return None


@cache
def recorded() -> Recording:
    """Frames of four robots, after they have come near intruders."""
    parameters = DetectionParameters.of(engine="fast", robots=TEAM)
    frames, tracker, times_s = [], Tracker(), []
    with DetectionTrial(parameters, SEED) as trial:
        for number in range(WARM_UP + FRAMES):
            frame, time_s = trial.next_frame(), trial.fleet.time_s
            places = [box.center for box in frame.detections]
            tracks = tracker.update(places, time_s)
            if number < WARM_UP:  # robots are where they start, and intruders are far
                continue
            targets = {track: TargetState(at, time_s, ()) for track, at in zip(tracks, places, strict=True)}
            observations = trial.observations(trial.detector)
            begin = time.perf_counter()
            trial.detector.midnet.update(observations)
            times_s.append(time.perf_counter() - begin)
            found = trial.detector.midnet.found_by_each(observations)
            team = trial.detector.midnet.team_of(found, [one.pose for one in observations])
            kept = np.concatenate(found)[team.kept]
            boxes = [kept[team.starts[i] : team.starts[i + 1]] for i in range(TEAM)]
            seen = trial.metric_frame(ScoredFrame(number, frame, trial.truths(), trial.in_range()))
            frames.append(Frame(observations, boxes, time_s, targets, number % TEAM, seen))
        paper_ms = 1e3 * statistics.median(times_s)
        range_m = parameters.costmap.obstacle_range_m
        recording = Recording(frames, trial.prior_map, range_m, trial.patrol.points, paper_ms)
    observed = [one for given in frames for one in given.observations]
    arrays = [own for given in frames for own in given.boxes]
    arrays += [one.scan.ranges_m for one in observed if one.scan is not None]
    for array in [*arrays, *(one.costmap.data for one in observed)]:
        array.setflags(write=False)
    return recording


def _same(some: Answers, others: Answers) -> bool:
    return len(some) == len(others) and all(
        np.array_equal(one, other, equal_nan=True) for one, other in zip(some, others, strict=True)
    )


@contextlib.contextmanager
def _random_state_kept() -> Iterator[None]:
    states = random.getstate(), np.random.get_state()  # noqa: NPY002
    try:
        yield
    finally:
        random.setstate(states[0])
        np.random.set_state(states[1])  # noqa: NPY002


def _world(engine: str, robot: RobotModel = BURGER) -> World:
    """Robots in the middle of an empty Map 1."""
    layout = place(load_arena("empty"), SEED, TEAM, 0, robot.body_reach_m)
    return World(layout, WorldSettings(engine=engine), robot)


def _drive(world: World, command: Command, seconds: float) -> None:
    for index in range(len(world.active)):
        world.drive(index, command)
    for _ in range(round(seconds * world.step_hz)):
        world.step()


def _engine_ms(name: str) -> float:
    """Median time of the engine's share of a frame."""
    world, times_s = _world(name), []
    for _ in range(FRAMES):
        begin = time.perf_counter()
        _drive(world, Command(0.1, 0.5), 1.0 / FRAME_HZ)
        times_s.append(time.perf_counter() - begin)
    world.close()
    return 1e3 * statistics.median(times_s)


def _engine_faults(name: str) -> Iterator[str]:
    """Faults of how robots move, of repeatability and of where beams end, beside the fast engine."""
    yield from _motion_faults(_world(name))
    one, other, fast = _world(name), _world(name), _world("fast")
    for world in (one, other):
        _drive(world, Command(0.15, 0.6), 1.0)
    if not np.array_equal(one.poses(), other.poses()):
        yield "two worlds that were made and driven alike differ: hidden randomness, or shared state?"
    cosines, sines = np.ascontiguousarray(directions(LDS_01.angles_rad).T)
    beams = Beams(*beam_directions(np.array(one.layout.robots), 0.0, cosines, sines))
    far_m = 3.0 * LDS_01.range_max_m
    ranges_m, true_m = (world.cast(beams, LDS_01.range_min_m, far_m) for world in (one, fast))
    with np.errstate(invalid="ignore"):  # inf where neither meets anything
        is_off = (ranges_m != true_m) & ~(np.abs(ranges_m - true_m) < MAX_OFF_M)
    if is_off.mean() > MAX_SHARE_OFF:
        yield f"cast: {is_off.mean():.0%} of beams end more than 1 mm from where walls begin"


def _robot_faults(robot: RobotModel) -> Iterator[str]:
    for engine in ("fast", "bullet"):
        with contextlib.suppress(ImportError):  # without PyBullet
            yield from (f"on {engine}: {fault}" for fault in _motion_faults(_world(engine, robot)))


def _motion_faults(world: World) -> Iterator[str]:
    """Faults of how robots start, drive, turn and stop, and of their wheel angles; closes the world."""
    robot, starts = world.robot, np.array(world.layout.robots)
    off = world.poses() - starts
    off[:, 2] = (off[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    if np.abs(off).max() > 0.01:
        yield "poses: robots do not stand where they start"
    ahead, turn = Command(0.8 * robot.max_linear_mps, 0.0), Command(0.0, 0.5 * robot.max_angular_radps)
    before = world.wheel_angles()
    for command in (ahead, turn, STOP):
        _drive(world, command, 1.5)
        velocities = world.velocities()
        off = np.abs(velocities - command) - 0.1 * np.abs(command)
        if (off > (SLOW_MPS, SLOW_RADPS)).any():
            linear_mps, angular_radps = velocities[off.max(axis=1).argmax()]
            yield (
                f"drive: told {command.linear_mps:.2f} m/s and {command.angular_radps:.2f} rad/s, "
                f"a robot moves at {linear_mps:.2f} m/s and {angular_radps:.2f} rad/s after 1.5 s"
            )
        if command is ahead:
            rolled = (world.wheel_angles() - before).mean(axis=1) * robot.wheel_radius_m
            driven = lengths(world.poses()[:, :2] - starts[:, :2])
            if (np.abs(rolled - driven) > 0.1 * driven + 0.01).any():
                yield f"wheel_angles: wheels rolled {rolled[0]:.2f} m where a robot drove {driven[0]:.2f} m"
    world.close()


PLUGINS = (
    Plugin(DETECTORS, _detector, _odd_box),
    Plugin(FUSIONS, _fusion, _odd_box),
    Plugin(PATROLS, _patrol, _odd_point),
    Plugin(PURSUITS, _pursuit, experiment="labyrinth", short_trial=CHASE),
    Plugin(METRICS, _metric),
    Plugin(SIMULATORS, None, short_trial={"robots": 3, "frames": 10}),
    Plugin(ROBOTS, None),
)
"""Code that fits several is taken for the first of them."""
