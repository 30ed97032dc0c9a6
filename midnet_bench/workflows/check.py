"""``check``: runs the rows of ``ROWS`` on a plug-in; its faults with file and line.

``PLUGINS`` says how trials call the code of each extension point and within which bounds its answers lie.
What calls it raises PluginError at answers of another shape.
"""

import ast
import contextlib
import random
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
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
OFF_M = 1.0  # farther off the map, or off the points of the patrol, nothing is sought and nobody sent
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
Faults = Iterable[str]
Bounds = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], str]
"""lowest and highest values of an answer, and a hint on one that is not within them"""


class Plugin(NamedTuple):
    """How trials call the code of an extension point."""

    point: ExtensionPoint
    call: Callable[[str, Recording, int], Call] | None
    """from a pinned name, the recording and the number of guards; None: it is no code that frames call"""
    bounds: Callable[[Recording], Bounds] | None = None
    experiment: str = "detection"
    short_trial: Mapping[str, Scalar] = SHORT


@dataclass
class Checked:
    """A plug-in under check, and what came of it."""

    plugin: Plugin
    name: str  # with its pin
    faults: list[str] = field(default_factory=list)  # a line for each; empty without faults
    times_s: list[float] = field(default_factory=list)  # of each frame that called it
    elsewhere: bytes | None = None  # the tables of a short trial in another process

    @property
    def option(self) -> str:
        """The option that it is for."""
        return self.plugin.point.option

    @cached_property
    def frame_ms(self) -> float | None:
        """Median time of a frame of four robots; None with faults, or where frames do not call it."""
        point = self.plugin.point
        if not self.faults and point is SIMULATORS:
            return _engine_ms(self.name)
        if point in (DETECTORS, FUSIONS) and point.is_made_here(self.name):
            return recorded().paper_ms
        return 1e3 * statistics.median(self.times_s) if self.times_s and not self.faults else None

    def trial(self) -> tuple[Any, Any]:
        """What runs a short trial with it, and the trial's spec."""
        parameters = {**self.plugin.short_trial, self.plugin.point.option: self.name}
        definition = {"experiment": self.plugin.experiment, "parameters": parameters}
        campaign = parse_campaign({**definition, "trials": 1, "base_seed": SEED}, "check")
        (spec,) = (resolved := resolve(campaign, registry)).trials()
        return resolved.run_trials, spec

    def answers(self, seed: int = 1, frames: list[Frame] | None = None) -> Answers:
        """Of a new instance to frames, to the recorded ones unless given. Raises PluginError.

        ``seed``: of the global random numbers.
        """
        shared, frames = recorded(), recorded().frames if frames is None else frames
        own_map = shared.prior_map.with_data(shared.prior_map.data.copy())
        own = shared._replace(prior_map=own_map, points=shared.points.copy())
        answers: Answers = []
        with _global_random_numbers(seed):
            call = self.plugin.call(self.name, own, len(frames[0].observations))  # type: ignore[misc]
            for frame in frames:
                begin = time.perf_counter()
                of_frame = call(replace(frame, observations=[*frame.observations], boxes=[*frame.boxes]))
                self.times_s.append(time.perf_counter() - begin)
                answers += of_frame
        return answers


class Row(NamedTuple):
    """One check, and the extension points whose plug-ins it is for."""

    of: tuple[ExtensionPoint, ...]
    faults: Callable[[Checked], Faults]
    ends: bool = False  # whether a fault here ends the check: the rows below would say it again


def check(thing: str) -> Checked:
    """What is wrong with the code that ``thing`` names.

    Args:
        thing: a value of ``--detector``, ``--fusion``, ``--patrol``, ``--pursuit``, ``--metric``,
            ``--engine`` or ``--robot-model``.

    Raises:
        InputError: there is no such code, or it is for no extension point.
    """
    if thing.endswith(".py"):
        raise InputError(f"{thing}: which class? {_classes_in(Path(thing))}")
    plugin = _plugin_of(thing)
    point, case = plugin.point, Checked(plugin, plugin.point.pinned(thing))
    if point.is_made_here(case.name):
        return case
    run_trials, spec = Checked(plugin, next(iter(point.own))).trial()
    run_trials([spec])  # compiles what it needs: the time limit is for the plug-in alone
    for row in (row for row in ROWS if point in row.of):
        try:
            case.faults += [point.line_of(case.name) + line for line in row.faults(case)]
        except PluginError as error:  # it names file and line
            case.faults.append(str(error))
        if case.faults and row.ends:
            break
    case.faults = list(dict.fromkeys(case.faults))
    return case


def detector_ms(name: str) -> float:
    """Median time of a frame of four robots by a pinned detector, ms; the paper's includes its fusion."""
    case = Checked(PLUGINS[0], name)
    if not DETECTORS.is_made_here(name):
        case.answers()
    return case.frame_ms or 0.0


@contextlib.contextmanager
def _global_random_numbers(seed: int) -> Iterator[None]:
    """Those of Python and NumPy, which a plug-in may draw from, by this seed; as they were afterwards."""
    states = random.getstate(), np.random.get_state()  # noqa: NPY002
    random.seed(seed)
    np.random.seed(seed)  # noqa: NPY002
    try:
        yield
    finally:
        random.setstate(states[0])
        np.random.set_state(states[1])  # noqa: NPY002


def _plugin_of(thing: str) -> Plugin:
    """Of the first extension point that takes it. Raises InputError: none does."""
    complaints = []
    for plugin in PLUGINS:
        try:
            plugin.point.pinned(thing)
            return plugin
        except InputError as error:
            complaints.append(str(error))
    points = [plugin.point for plugin in PLUGINS]
    if all(f"expected {point.wanted}" in text for point, text in zip(points, complaints, strict=True)):
        wanted = " or ".join(f"{point.wanted} ({point.option})" for point in points)
        raise InputError(f"{thing}: expected {wanted.replace(' or a class with a method', ',')}")
    raise InputError(complaints[0].removeprefix(f"{points[0].option}: "))


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


def _map_bounds(recording: Recording) -> Bounds:
    x_min, y_min, x_max, y_max = recording.prior_map.extent
    low, high = np.array((x_min, y_min) * 2) - OFF_M, np.array((x_max, y_max) * 2) + OFF_M
    return low, high, "are these metres? is it in the map frame?"


def _patrol_bounds(recording: Recording) -> Bounds:
    low, high = recording.points.min(axis=0) - OFF_M, recording.points.max(axis=0) + OFF_M
    return low, high, "return one of the points that the constructor got"


def _rare(frame: Frame) -> dict[str, Frame]:
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


def _runs_elsewhere(case: Checked) -> list[str]:
    """A short trial in another process, where it may hang, fail or end the process."""
    run_trials, spec = case.trial()
    with contextlib.closing(LocalPool(1).outcomes(run_trials, iter([[spec]]), LIMIT_S)) as outcomes:
        (outcome,) = outcomes
    case.elsewhere = outcome.payload
    if outcome.failure is None:
        return []
    raise PluginError(outcome.failure.splitlines()[-1].split("PluginError: ", 1)[-1])


def _runs_here_alike(case: Checked) -> Faults:
    run_trials, spec = case.trial()
    if attempt(run_trials, [spec])[0].payload != case.elsewhere:
        yield (
            "another process gets other results from the same trial: does it depend on the "
            "order of a set, an id, the clock or the environment?"
        )


def _answers_within_bounds(case: Checked) -> Faults:
    """To frames whose arrays cannot be written to."""
    answers = case.answers()
    if case.plugin.bounds is None:
        return
    low, high, hint = case.plugin.bounds(recorded())
    for answer in np.concatenate([np.atleast_2d(answer) for answer in answers]):
        if ((answer < low) | (answer > high)).any():
            where, least, most = (", ".join(f"{n:.3g}" for n in numbers) for numbers in (answer, low, high))
            yield f"({where}) m is not within ({least}) and ({most}) m: {hint}"
            return


def _answers_alike(case: Checked) -> Faults:
    first, other, again = ([(one.shape, one.tobytes()) for one in case.answers(seed)] for seed in (1, 2, 1))
    if first != again:
        yield "it answers otherwise the second time: does it keep state at the class, or read the clock?"
    elif first != other:
        yield "it draws from the global random numbers: take a generator with a fixed seed"


def _answers_rare(what: str, case: Checked) -> list[str]:
    """A frame as it is rare in trials."""
    try:
        case.answers(frames=[_rare(recorded().frames[-1])[what]])
    except PluginError as error:
        raise PluginError(f"with {what}: {error}") from error
    return []


def _moves_alike(case: Checked) -> Faults:
    one, other = _world(case.name), _world(case.name)
    for world in (one, other):
        _drive(world, Command(0.15, 0.6), 1.0)
    if not np.array_equal(one.poses(), other.poses()):
        yield "two worlds that were made and driven alike differ: hidden randomness, or shared state?"


def _beams_end_at_walls(case: Checked) -> Faults:
    """Where those of the fast engine do."""
    own, fast = _world(case.name), _world("fast")
    cosines, sines = np.ascontiguousarray(directions(LDS_01.angles_rad).T)
    beams = Beams(*beam_directions(np.array(own.layout.robots), 0.0, cosines, sines))
    far_m = 3.0 * LDS_01.range_max_m
    ranges_m, true_m = (world.cast(beams, LDS_01.range_min_m, far_m) for world in (own, fast))
    with np.errstate(invalid="ignore"):  # inf where neither meets anything
        is_off = (ranges_m != true_m) & ~(np.abs(ranges_m - true_m) < MAX_OFF_M)
    if is_off.mean() > MAX_SHARE_OFF:
        yield f"cast: {is_off.mean():.0%} of beams end more than 1 mm from where walls begin"


def _robot_moves(engine: str, case: Checked) -> Faults:
    with contextlib.suppress(ImportError):  # without PyBullet
        world = _world(engine, ROBOTS.make(case.name))
        yield from (f"on {engine}: {fault}" for fault in _motion_faults(world))


def _motion_faults(world: World) -> Faults:
    """How robots start, drive, turn and stop, and what their wheels roll; closes the world."""
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
    Plugin(DETECTORS, _detector, _map_bounds),
    Plugin(FUSIONS, _fusion, _map_bounds),
    Plugin(PATROLS, _patrol, _patrol_bounds),
    Plugin(PURSUITS, _pursuit, experiment="labyrinth", short_trial=CHASE),
    Plugin(METRICS, _metric),
    Plugin(SIMULATORS, None, short_trial={"robots": 3, "frames": 10}),
    Plugin(ROBOTS, None),
)
"""Code that fits several is taken for the first of them."""
EVERY = tuple(plugin.point for plugin in PLUGINS)
CALLED = tuple(plugin.point for plugin in PLUGINS if plugin.call)
RARE = ("nobody", "one robot that has seen nothing", f"{FULL_TEAM} robots", "no intruders")
ROWS = (
    Row(EVERY, _runs_elsewhere, ends=True),
    Row(CALLED, _answers_within_bounds, ends=True),
    Row(CALLED, _answers_alike),
    *(Row(CALLED, partial(_answers_rare, what)) for what in RARE),
    *(Row((ROBOTS,), partial(_robot_moves, engine)) for engine in ("fast", "bullet")),
    Row((SIMULATORS,), lambda case: _motion_faults(_world(case.name))),
    Row((SIMULATORS,), _moves_alike),
    Row((SIMULATORS,), _beams_end_at_walls),
    Row(EVERY, _runs_here_alike),
)
