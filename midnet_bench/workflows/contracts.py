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
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.pipeline import Observation
from midnet_bench.rivals.patrol import TeamPatrol
from midnet_bench.rivals.pursuit import TeamPursuit
from midnet_bench.rivals.seams import DETECTORS, FUSIONS, PATROLS, PURSUITS
from midnet_bench.rivals.team import detected, fused
from midnet_bench.scoring.metric import MetricFrame, TrialMetrics
from midnet_bench.scoring.seams import METRICS
from midnet_bench.seams import PluginError, Seam
from midnet_bench.settings import Scalar

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


CONTRACTS: tuple[Contract, ...] = (
    DetectorContract(),
    FusionContract(),
    PatrolContract(),
    PursuitContract(),
    MetricContract(),
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
