"""``Contract``: what code at each seam keeps to, found out by asking it what a trial would ask."""

import contextlib
import copy
import random
import statistics
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.agents.mobile_robot import GuardState
from midnet_bench.agents.pursuit import TargetState
from midnet_bench.agents.tracking import Tracker
from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.elementary import directions
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.geometry import lengths
from midnet_bench.grid import OccupancyGrid
from midnet_bench.messages import STOP, Command
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.pipeline import Observation
from midnet_bench.rivals.patrol import TeamPatrol
from midnet_bench.rivals.pursuit import TeamPursuit
from midnet_bench.rivals.seams import DETECTORS, FUSIONS, PATROLS, PURSUITS
from midnet_bench.rivals.team import detected, fused
from midnet_bench.robots.burger import BURGER, LDS_01
from midnet_bench.robots.model import RobotModel
from midnet_bench.robots.seams import ROBOTS as ROBOT_MODELS
from midnet_bench.scoring.metric import MetricFrame, TrialMetrics
from midnet_bench.scoring.seams import METRICS
from midnet_bench.seams import PluginError, Seam
from midnet_bench.settings import Scalar
from midnet_bench.simulation.engines import make_world
from midnet_bench.simulation.lidar import beam_directions
from midnet_bench.simulation.seams import SIMULATORS
from midnet_bench.simulation.settings import WorldSettings
from midnet_bench.simulation.simulator import Beams, Simulator

ROBOTS, FRAMES, SEED = 4, 12, 3001
WARM_UP = 25
"""frames before those that are looked at"""
FULL_TEAM = 20
OFF_MAP_M, LARGEST_M = 1.0, 5.0
"""A box farther off the map, or with a longer side, is in other units or another frame."""
NEAR_M = 0.5
"""from where a guard is sent to the nearest place where it may be"""


class Contract(ABC):
    """What is agreed at one seam; one of these for each."""

    seam: ClassVar[Seam]
    experiment: ClassVar[str] = "detection"
    short_trial: ClassVar[Mapping[str, Scalar]] = {"engine": "fast", "robots": 3, "frames": 10}
    """parameters of the trial that is run with the code in it, here and in another process"""

    @abstractmethod
    def faults(self, name: str) -> Iterator[str]:
        """A line for each thing that is wrong with the code that ``name``, a pinned value, names."""

    def frame_ms(self, name: str) -> float | None:
        """Its median time for a frame of four robots; None where frames are none of its business."""
        return None


@dataclass(frozen=True)
class Instant:
    """What a team knows at one frame of a recorded trial."""

    observations: list[Observation]
    found: list[BoxArray]
    """by robot, without its allies"""
    time_s: float
    targets: Mapping[int, TargetState] = field(default_factory=dict)
    """tracks of the team's boxes"""
    asking: int = 0
    """the guard that wants to know where to go"""
    seen: MetricFrame | None = None
    """what metrics go by"""

    @property
    def team(self) -> list[GuardState]:
        """As a patrol rule sees it; every other guard is on its way to the middle."""
        return [
            GuardState((one.pose.x, one.pose.y), (0.0, 0.0) if i % 2 else None)
            for i, one in enumerate(self.observations)
        ]

    def arrays(self) -> list[Any]:
        """Everything in it that could be written to."""
        arrays: list[Any] = list(self.found)
        for one in self.observations:
            arrays += [one.costmap.data, np.array(one.pose)]
            if one.scan is not None:
                arrays += [one.scan.ranges_m, np.array(one.scan.pose)]
        return arrays


class Recording(NamedTuple):
    """A team in motion in the fast engine's Map 1."""

    instants: list[Instant]
    prior_map: OccupancyGrid
    range_m: float
    """up to which an intruder has to be found"""
    points: npt.NDArray[np.float64]
    """(n, 2) where a guard may be sent"""

    def of_its_own(self) -> "Recording":
        """The same with a map and points that may be written to."""
        prior_map = self.prior_map.with_data(self.prior_map.data.copy())
        return self._replace(prior_map=prior_map, points=self.points.copy())


Answers = list[npt.NDArray[np.float64]]
Answering = Callable[[Instant], Answers]


class FrameContract(Contract):
    """Of code that is made for a trial and asked at its frames."""

    @abstractmethod
    def make(self, name: str, recording: Recording) -> Answering:
        """A fresh one, made and asked as a trial does it; what it answers is checked.

        Raises:
            PluginError: it cannot be made; or later, as it is asked, what it answers is refused.
        """

    def oddity(self, answers: Answers, recording: Recording) -> str | None:
        """What is odd about answers that a trial would take."""
        return None

    def extremes(self, instant: Instant) -> dict[str, Instant]:
        """What it must take too, in words: nobody, one that has seen nothing, and a full team."""
        nothing = np.empty((0, 4))
        unseen = [
            replace(one, scan=None, costmap=one.costmap.with_data(np.zeros_like(one.costmap.data)))
            for one in instant.observations[:1]
        ]
        times = FULL_TEAM // ROBOTS
        return {
            "nobody": Instant([], [], instant.time_s),
            "one robot that has seen nothing": Instant(unseen, [nothing], instant.time_s),
            f"{FULL_TEAM} robots": Instant(
                instant.observations * times, instant.found * times, instant.time_s
            ),
        }

    def faults(self, name: str) -> Iterator[str]:
        """See :class:`Contract`."""
        recording = recorded()
        with _random_state_kept():
            for kept in (self._keeps_its_hands_off, self._repeats, self._takes_any_team, self._is_not_odd):
                try:
                    yield from kept(lambda: self.make(name, recording.of_its_own()), recording)
                except PluginError as error:
                    yield str(error)

    def frame_ms(self, name: str) -> float | None:
        """See :class:`Contract`."""
        if self.seam.is_made_here(name):
            return None
        recording = recorded()
        answer, times = self.make(name, recording.of_its_own()), []
        for instant in recording.instants:
            start_s = time.perf_counter()
            answer(instant)
            times.append(time.perf_counter() - start_s)
        return 1e3 * statistics.median(times)

    def _keeps_its_hands_off(self, make: Callable[[], Answering], recording: Recording) -> Iterator[str]:
        """What it is given stays as it was."""
        answer = make()
        for instant in recording.instants:
            given = copy.deepcopy(instant)
            answer(given)
            if not _same(given.arrays(), instant.arrays()):
                yield f"{self.seam.method} changes what it is given: work on a copy"
                return

    def _repeats(self, make: Callable[[], Answering], recording: Recording) -> Iterator[str]:
        """A fresh one answers the same again, whatever the global random numbers are."""

        def run(seed: int) -> Answers:
            random.seed(seed)
            np.random.seed(seed)  # noqa: NPY002 - the one that code under test may draw from
            answer = make()
            return [one for instant in recording.instants for one in answer(copy.deepcopy(instant))]

        first, other, again = run(1), run(2), run(1)
        if _same(first, other):
            return
        if _same(first, again):
            yield "it draws from the global random numbers: take a generator with a seed of its own"
        else:
            yield (
                "it answers otherwise the second time: does it keep something at the class, or ask the clock?"
            )

    def _takes_any_team(self, make: Callable[[], Answering], recording: Recording) -> Iterator[str]:
        for words, instant in self.extremes(recording.instants[-1]).items():
            try:
                make()(copy.deepcopy(instant))
            except PluginError as error:
                yield f"with {words}: {error}"

    def _is_not_odd(self, make: Callable[[], Answering], recording: Recording) -> Iterator[str]:
        answer = make()
        for instant in recording.instants:
            oddity = self.oddity(answer(copy.deepcopy(instant)), recording)
            if oddity:
                yield oddity
                return


class BoxContract(FrameContract):
    """Of code that gives boxes: they lie where robots can be, and are as large as things are."""

    def oddity(self, answers: Answers, recording: Recording) -> str | None:
        """See :class:`FrameContract`."""
        x_min, y_min, x_max, y_max = recording.prior_map.extent
        for box in np.concatenate(answers):
            width, height = box[2:] - box[:2]
            if max(width, height) > LARGEST_M:
                return f"a box of {width:.3g} x {height:.3g} m: are these metres?"
            if (
                box[0] < x_min - OFF_MAP_M
                or box[1] < y_min - OFF_MAP_M
                or box[2] > x_max + OFF_MAP_M
                or box[3] > y_max + OFF_MAP_M
            ):
                return (
                    f"a box at ({box[0]:.3g}, {box[1]:.3g}) m is off the map, which is from ({x_min:.3g}, "
                    f"{y_min:.3g}) to ({x_max:.3g}, {y_max:.3g}) m: is it in the map frame?"
                )
        return None

    def frame_ms(self, name: str) -> float | None:
        """See :class:`Contract`; of what MIDNet does itself, the time of both parts."""
        return _own_time_ms() if self.seam.is_made_here(name) else super().frame_ms(name)


class DetectorContract(BoxContract):
    """Boxes of each robot's observation."""

    seam = DETECTORS

    def make(self, name: str, recording: Recording) -> Answering:
        """See :class:`FrameContract`."""
        made = DETECTORS.make(name, recording.prior_map, recording.range_m)
        return lambda instant: detected(made, name, instant.observations)


class FusionContract(BoxContract):
    """One list of boxes of the robots' lists."""

    seam = FUSIONS

    def make(self, name: str, recording: Recording) -> Answering:
        """See :class:`FrameContract`."""
        made = FUSIONS.make(name)
        return lambda instant: [fused(made, name, instant.found, instant.time_s)]


class PatrolContract(FrameContract):
    """Points where guards may be."""

    seam = PATROLS

    def make(self, name: str, recording: Recording) -> Answering:
        """See :class:`FrameContract`; patrols are told the team's size, so one is made for each."""
        patrols: dict[int, TeamPatrol] = {}

        def answer(instant: Instant) -> Answers:
            guards = len(instant.team)
            if guards not in patrols:
                patrols[guards] = TeamPatrol(name, recording.points, guards, np.random.default_rng(SEED))
            return [np.array([patrols[guards].next_point(instant.asking, instant.team, instant.time_s)])]

        return answer

    def oddity(self, answers: Answers, recording: Recording) -> str | None:
        """See :class:`FrameContract`."""
        ((point,),) = answers
        if np.hypot(*(recording.points - point).T).min() <= NEAR_M:
            return None
        return (
            f"it sends a guard to ({point[0]:.3g}, {point[1]:.3g}) m, where none may be: give one of the "
            "points that it was made of"
        )

    def extremes(self, instant: Instant) -> dict[str, Instant]:
        """See :class:`FrameContract`; where nobody is, nobody asks."""
        return {words: one for words, one in super().extremes(instant).items() if one.observations}


class PursuitContract(FrameContract):
    """Targets of guards, checked as they are given."""

    seam = PURSUITS
    experiment = "labyrinth"
    short_trial: ClassVar = {
        "engine": "fast",
        "arena": "map1",  # everybody is near everybody
        "escape_distance_m": 2.0,
        "robots": 3,
        "intruders": 3,
        "time_limit_s": 15.0,
    }

    def make(self, name: str, recording: Recording) -> Answering:
        """See :class:`FrameContract`; it is asked where there are targets."""
        rule = TeamPursuit(name, recording.prior_map, np.random.default_rng(SEED))

        def answer(instant: Instant) -> Answers:
            if not instant.targets:
                return []
            sent = rule.pursue(instant.team, instant.targets, instant.time_s)
            return [np.array(sorted(sent.items()), np.float64)]

        return answer

    def extremes(self, instant: Instant) -> dict[str, Instant]:
        """See :class:`FrameContract`; more guards than targets, and fewer."""
        places = [one.place for one in instant.team]
        one, many = (
            {
                number: TargetState(places[number % ROBOTS], instant.time_s, ())
                for number in range(5, 5 + count)
            }
            for count in (1, FULL_TEAM)
        )
        full = instant.observations * (FULL_TEAM // ROBOTS)
        return {
            f"{FULL_TEAM} robots and one target": replace(instant, observations=full, targets=one),
            f"one robot and {FULL_TEAM} targets": replace(
                instant, observations=instant.observations[:1], targets=many
            ),
        }


class MetricContract(FrameContract):
    """Numbers by name, checked as they are given."""

    seam = METRICS

    def make(self, name: str, recording: Recording) -> Answering:
        """See :class:`FrameContract`; metrics see the truth, too."""
        metrics = TrialMetrics(name)

        def answer(instant: Instant) -> Answers:
            assert instant.seen is not None
            return [np.array(list(metrics.update(instant.seen).values()))]

        return answer

    def extremes(self, instant: Instant) -> dict[str, Instant]:
        """See :class:`FrameContract`; frames in which boxes, intruders or both are missing."""
        assert instant.seen is not None
        seen, nothing = instant.seen, np.empty((0, 4))
        nobody = seen._replace(truths=(), in_range=())
        frames = {
            "no boxes": seen._replace(boxes=nothing),
            "no intruders": nobody,
            "no boxes and no intruders": nobody._replace(boxes=nothing),
            "guards that have all died": seen._replace(guards=np.empty((0, 2))),
        }
        return {words: replace(instant, seen=one) for words, one in frames.items()}


class WorldContract(Contract):
    """Of what makes a world in which robots move as they are told."""

    @abstractmethod
    def worlds(self, name: str) -> Iterator[tuple[str, Simulator]]:
        """What stands before its faults, and a world with robots that stand in the open."""

    def faults(self, name: str) -> Iterator[str]:
        """See :class:`Contract`."""
        try:
            for said, world in self.worlds(name):
                yield from (said + fault for fault in _wrong_moves(world))
                world.close()
        except (PluginError, InputError) as error:
            yield str(error).removeprefix(f"{self.seam.option} {name}: ")


class EngineContract(WorldContract):
    """``simulation/own_engine.py``."""

    seam = SIMULATORS
    short_trial: ClassVar[Mapping[str, Scalar]] = {"robots": 3, "frames": 10}

    def worlds(self, name: str) -> Iterator[tuple[str, Simulator]]:
        """See :class:`WorldContract`."""
        yield "", _world(name, BURGER)

    def faults(self, name: str) -> Iterator[str]:
        """See :class:`Contract`: also that two agree, and that beams end where walls are."""
        yield from super().faults(name)
        with contextlib.suppress(PluginError):  # it has been told
            one, other, fast = (_world(engine, BURGER) for engine in (name, name, "fast"))
            for world in (one, other):
                _drive(world, Command(0.15, 0.6), 1.0)
            if not np.array_equal(one.poses(), other.poses()):
                yield "two worlds that were made and driven alike differ: hidden randomness, or shared state?"
            cosines, sines = np.ascontiguousarray(directions(LDS_01.angles_rad).T)
            beams = Beams(*beam_directions(np.array(one.layout.robots), 0.0, cosines, sines))
            far_m = 3.0 * LDS_01.range_max_m
            found, true = (world.cast(beams, LDS_01.range_min_m, far_m) for world in (one, fast))
            with np.errstate(invalid="ignore"):  # inf where neither meets anything
                is_off = (found != true) & ~(np.abs(found - true) < MAX_OFF_M)
            if is_off.mean() > MAX_SHARE_OFF:
                yield f"cast: {is_off.mean():.0%} of beams end more than 1 mm from where walls begin"

    def frame_ms(self, name: str) -> float:
        """See :class:`Contract`."""
        world = _world(name, BURGER)
        ticks, times_s = world.step_hz // FRAME_HZ, []
        for _ in range(FRAMES):
            begin = time.perf_counter()
            _drive(world, Command(0.1, 0.5), ticks / world.step_hz)
            times_s.append(time.perf_counter() - begin)
        world.close()
        return 1e3 * statistics.median(times_s)


class RobotContract(WorldContract):
    """``robots/model.py``, which refuses by itself what no robot can be."""

    seam = ROBOT_MODELS

    def worlds(self, name: str) -> Iterator[tuple[str, Simulator]]:
        """See :class:`WorldContract`."""
        robot = ROBOT_MODELS.make(name)
        for engine in ("fast", "bullet"):
            try:
                yield f"on {engine}: ", _world(engine, robot)
            except ImportError:  # without PyBullet
                continue


MAX_OFF_M, MAX_SHARE_OFF = 1e-3, 0.01
"""Beams may graze a corner here and pass it there."""
SLOW_MPS, SLOW_RADPS = 0.02, 0.05
"""how far from what it was told a robot may move, beside a tenth of it"""


def _world(engine: str, robot: RobotModel) -> Simulator:
    """Robots in the middle of an empty Map 1."""
    layout = place(load_arena("empty"), SEED, ROBOTS, 0, robot.body_reach_m)
    return make_world(layout, WorldSettings(engine=engine), robot)


def _drive(world: Simulator, command: Command, seconds: float) -> None:
    for index in range(len(world.active)):
        world.drive(index, command)
    for _ in range(round(seconds * world.step_hz)):
        world.step()


def _wrong_moves(world: Simulator) -> Iterator[str]:
    """What is wrong with how robots stand, drive, turn, stop, and with what their wheels say of it."""
    robot, starts = world.robot, np.array(world.layout.robots)
    off = world.poses() - starts
    off[:, 2] = (off[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    if np.abs(off).max() > 0.01:
        yield "poses: robots do not stand where they start"
    ahead_mps, turn_radps = 0.8 * robot.max_linear_mps, 0.5 * robot.max_angular_radps
    before = world.wheel_angles()
    for command in (Command(ahead_mps, 0.0), Command(0.0, turn_radps), STOP):
        _drive(world, command, 1.5)
        moves = world.velocities()
        off = np.abs(moves - command) - 0.1 * np.abs(command)
        if (off > (SLOW_MPS, SLOW_RADPS)).any():
            speed, turn = moves[off.max(axis=1).argmax()]
            yield (
                f"drive: told {command.linear_mps:.2f} m/s and {command.angular_radps:.2f} rad/s, "
                f"a robot moves at {speed:.2f} m/s and {turn:.2f} rad/s after 1.5 s"
            )
        if command.linear_mps:
            rolled = (world.wheel_angles() - before).mean(axis=1) * robot.wheel_radius_m
            driven = lengths(world.poses()[:, :2] - starts[:, :2])
            if (np.abs(rolled - driven) > 0.1 * driven + 0.01).any():
                yield f"wheel_angles: wheels rolled {rolled[0]:.2f} m where a robot drove {driven[0]:.2f} m"


CONTRACTS: tuple[Contract, ...] = (
    DetectorContract(),
    FusionContract(),
    PatrolContract(),
    PursuitContract(),
    MetricContract(),
    EngineContract(),
    RobotContract(),
)
"""of all seams; code that fits several is taken for the first of them"""


@cache
def recorded() -> Recording:
    """Frames of four robots, after they have come near intruders."""
    parameters = DetectionParameters.of(engine="fast", robots=ROBOTS)
    instants, tracker = [], Tracker()
    with DetectionTrial(parameters, SEED) as trial:
        for number in range(WARM_UP + FRAMES):
            frame = trial.next_frame()
            places = [box.center for box in frame.detections]
            time_s = trial.fleet.time_s
            tracks = tracker.update(places, time_s)
            targets = {
                track: TargetState(place, time_s, ()) for track, place in zip(tracks, places, strict=True)
            }
            if number < WARM_UP:  # robots stand where they start, and intruders are far
                continue
            observations = trial.observations(trial.detector)
            boxes = trial.detector.midnet.found_by_each(observations)
            team = trial.detector.midnet.team_of(boxes, [one.pose for one in observations])
            kept = np.concatenate(boxes)[team.kept]
            found = [kept[team.starts[i] : team.starts[i + 1]] for i in range(ROBOTS)]
            seen = trial.seen_by_metrics(frame, trial.truths(), trial.in_range(parameters))
            instants.append(Instant(observations, found, time_s, targets, number % ROBOTS, seen))
        return Recording(instants, trial.prior_map, parameters.costmap.obstacle_range_m, trial.patrol.points)


def _own_time_ms() -> float:
    """Of the paper's detector and fusion."""
    parameters = DetectionParameters.of(engine="fast", robots=ROBOTS)
    times = []
    with DetectionTrial(parameters, SEED) as trial:
        for _ in range(FRAMES):
            trial.next_frame()
            observations = trial.observations(trial.detector)
            start_s = time.perf_counter()
            trial.detector.midnet.update(observations)
            times.append(time.perf_counter() - start_s)
    return 1e3 * statistics.median(times)


def _same(some: Sequence[Any], others: Sequence[Any]) -> bool:
    return len(some) == len(others) and all(
        np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
        for one, other in zip(some, others, strict=True)
    )


@contextlib.contextmanager
def _random_state_kept() -> Iterator[None]:
    plain, numpys = random.getstate(), np.random.get_state()  # noqa: NPY002
    try:
        yield
    finally:
        random.setstate(plain)
        np.random.set_state(numpys)  # noqa: NPY002
