"""``check``: whether code for a seam keeps to what is agreed, found by running it."""

import contextlib
import copy
import random
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from midnet_bench.campaign.definition import parse_campaign, resolve
from midnet_bench.campaign.pools import LokyPool, WorkersLost
from midnet_bench.campaign.worker import attempt
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.grid import OccupancyGrid
from midnet_bench.midnet.detection import BoxArray
from midnet_bench.midnet.pipeline import Observation
from midnet_bench.rivals.patrol import GuardState, TeamPatrol
from midnet_bench.rivals.seams import DETECTORS, FUSIONS, PATROLS
from midnet_bench.rivals.team import detected, fused
from midnet_bench.seams import PluginError, Seam

SEAMS = (DETECTORS, FUSIONS, PATROLS)
ROBOTS, FRAMES, SEED = 4, 12, 3001
WARM_UP = 25
"""frames before those that are looked at"""
FULL_TEAM = 20
LIMIT_S = 60.0
"""of a short trial in another process"""
OFF_MAP_M, LARGEST_M = 1.0, 5.0
"""A box farther off the map, or with a longer side, is in other units or another frame."""
NEAR_M = 0.5
"""from where a guard is sent to the nearest place where it may be"""


@dataclass(frozen=True)
class Checked:
    """What came of a check."""

    seam: str
    """its option"""
    name: str
    """what was checked, with its pin"""
    faults: list[str]
    """a line for each; empty where all is well"""
    frame_ms: float
    """median time of a frame of four robots"""


@dataclass(frozen=True)
class _Frame:
    """What both kinds of code are asked with."""

    observations: list[Observation]
    found: list[BoxArray]
    """by robot, without its allies"""
    time_s: float
    asking: int = 0
    """the guard that wants to know where to go"""

    @property
    def team(self) -> list[GuardState]:
        """As a patrol rule sees it; every other guard is on its way to the middle."""
        return [
            GuardState((one.pose.x, one.pose.y), (0.0, 0.0) if i % 2 else None)
            for i, one in enumerate(self.observations)
        ]


@dataclass(frozen=True)
class _Candidate:
    """The code under test, made and asked as a trial does it."""

    seam: Seam
    name: str
    prior_map: OccupancyGrid
    range_m: float
    points: npt.NDArray[np.float64]
    """(n, 2) where a guard may be sent"""

    def make(self) -> Callable[[_Frame], list[BoxArray]]:
        """A fresh one; what it returns answers a frame, checked: boxes, or a point. Raises PluginError."""
        if self.seam is PATROLS:
            return self._patrol()
        prior_map = self.prior_map.with_data(self.prior_map.data.copy())
        arguments = (prior_map, self.range_m) if self.seam is DETECTORS else ()
        made = self.seam.make(self.name, *arguments)

        def answer(frame: _Frame) -> list[BoxArray]:
            if self.seam is FUSIONS:
                return [fused(made, self.name, frame.found, frame.time_s)]
            return detected(made, self.name, frame.observations)

        return answer

    def _patrol(self) -> Callable[[_Frame], list[BoxArray]]:
        """Patrols are told the team's size, so one is made for each."""
        patrols: dict[int, TeamPatrol] = {}

        def answer(frame: _Frame) -> list[BoxArray]:
            guards = len(frame.team)
            if guards not in patrols:
                rng = np.random.default_rng(SEED)
                patrols[guards] = TeamPatrol(self.name, self.points.copy(), guards, rng)
            return [np.array([patrols[guards].next_point(frame.asking, frame.team, frame.time_s)])]

        return answer


def check(thing: str) -> Checked:
    """What is wrong with the code that ``thing`` names, found with robots in the fast engine's Map 1.

    Args:
        thing: what ``--detector``, ``--fusion`` or ``--patrol`` takes.

    Raises:
        InputError: there is no such code, or it is for no seam.
    """
    seam = _seam_of(thing)
    name = seam.pinned(thing)
    if seam.is_made_here(name):  # it is what all else is measured with
        return Checked(seam.option, name, [], _own_time_ms())
    elsewhere, faults = _in_another_process(seam, name)
    if faults:  # it hangs, fails or takes its process along
        return Checked(seam.option, name, faults, float("nan"))
    frames, prior_map, range_m, points = _recorded()
    candidate = _Candidate(seam, name, prior_map, range_m, points)
    frame_ms = float("nan")
    with _random_state_kept():
        for contract in (_keeps_its_hands_off, _repeats, _takes_any_team, _speaks_in_metres):
            try:
                faults += contract(candidate, frames)
            except PluginError as error:
                faults.append(str(error))
        if not faults:
            frame_ms = _time_ms(candidate, frames)
    here = attempt(*_trial(seam, name), LIMIT_S, None)
    if not faults and here.payload != elsewhere:
        faults.append(
            "another process gets other results from the same trial: does it go by the order of a set, an "
            "id, the clock or the environment?"
        )
    return Checked(seam.option, name, list(dict.fromkeys(faults)), frame_ms)


def _seam_of(thing: str) -> Seam:
    """Where the code goes: the seam that has its name, else the first whose method its class has."""
    complaints = []
    for seam in SEAMS:
        try:
            seam.pinned(thing)
            return seam
        except InputError as error:
            complaints.append(str(error))
    if all(f"with a method '{seam.method}'" in said for seam, said in zip(SEAMS, complaints, strict=True)):
        methods = " or ".join(f"'{seam.method}' ({seam.option})" for seam in SEAMS)
        raise InputError(f"{thing}: expected a class with a method {methods}")
    raise InputError(complaints[0].removeprefix(f"{SEAMS[0].option}: "))


def _trial(seam: Seam, name: str) -> tuple[Any, Any]:
    """A short trial with the code in it: what runs it, and its spec."""
    parameters = {"engine": "fast", "robots": 3, "frames": 10, seam.option: name}
    campaign = parse_campaign(
        {"experiment": "detection", "parameters": parameters, "trials": 1, "base_seed": SEED}, "check"
    )
    resolved = resolve(campaign, registry)
    (spec,) = resolved.trials()
    return resolved.run_trial, spec


def _in_another_process(seam: Seam, name: str) -> tuple[bytes | None, list[str]]:
    """The tables of a short trial there, and what went wrong."""
    run_trial, spec = _trial(seam, name)
    with tempfile.TemporaryDirectory() as folder:
        pool = LokyPool(1, Path(folder) / "marks")
        try:
            with contextlib.closing(pool.outcomes(run_trial, iter([spec]), LIMIT_S, True)) as outcomes:
                (outcome,) = outcomes
        except WorkersLost as lost:
            return None, [f"it takes its process along: {lost}"]
        finally:
            pool.close()
    if outcome.failure is None:
        return outcome.payload, []
    said = outcome.failure.splitlines()[-1]
    return None, [said.split("PluginError: ", 1)[-1]]


@cache
def _recorded() -> tuple[list[_Frame], OccupancyGrid, float, npt.NDArray[np.float64]]:
    """Frames of a team in motion, the prior map, the usable range, and where a patrol may go."""
    parameters = DetectionParameters.of(engine="fast", robots=ROBOTS)
    frames = []
    with DetectionTrial(parameters, SEED) as trial:
        for number in range(WARM_UP + FRAMES):
            trial.next_frame()
            if number < WARM_UP:  # robots stand where they start, and intruders are far
                continue
            observations = trial.observations(trial.detector)
            boxes = trial.detector.midnet.found_by_each(observations)
            team = trial.detector.midnet.team_of(boxes, [one.pose for one in observations])
            kept = np.concatenate(boxes)[team.kept]
            found = [kept[team.starts[i] : team.starts[i + 1]] for i in range(ROBOTS)]
            frames.append(_Frame(observations, found, trial.fleet.time_s, number % ROBOTS))
        return frames, trial.prior_map, parameters.costmap.obstacle_range_m, trial.patrol.points


def _keeps_its_hands_off(candidate: _Candidate, frames: list[_Frame]) -> Iterator[str]:
    """What it is given stays as it was."""
    answer = candidate.make()
    for frame in frames:
        given = copy.deepcopy(frame)
        answer(given)
        if not _same(_arrays(given), _arrays(frame)):
            yield f"{candidate.seam.method} changes what it is given: work on a copy"
            return


def _repeats(candidate: _Candidate, frames: list[_Frame]) -> Iterator[str]:
    """A fresh one gives the same boxes again, whatever the global random numbers are."""

    def run(seed: int) -> list[BoxArray]:
        random.seed(seed)
        np.random.seed(seed)  # noqa: NPY002 - the one that code under test may draw from
        answer = candidate.make()
        return [boxes for frame in frames for boxes in answer(copy.deepcopy(frame))]

    first, other, again = run(1), run(2), run(1)
    if _same(first, other):
        return
    if _same(first, again):
        yield "it draws from the global random numbers: take a generator with a seed of its own"
    else:
        yield "it gives other boxes the second time: does it keep something at the class, or ask the clock?"


def _takes_any_team(candidate: _Candidate, frames: list[_Frame]) -> Iterator[str]:
    """Nobody, one that has seen nothing, and a full team."""
    frame = frames[-1]
    nothing = np.empty((0, 4))
    unseen = [
        replace(one, scan=None, costmap=one.costmap.with_data(np.zeros_like(one.costmap.data)))
        for one in frame.observations[:1]
    ]
    times = FULL_TEAM // ROBOTS
    teams = {
        "nobody": _Frame([], [], frame.time_s),
        "one robot that has seen nothing": _Frame(unseen, [nothing], frame.time_s),
        f"{FULL_TEAM} robots": _Frame(frame.observations * times, frame.found * times, frame.time_s),
    }
    for team, asked in teams.items():
        if candidate.seam is PATROLS and not asked.observations:
            continue  # nobody asks
        try:
            candidate.make()(copy.deepcopy(asked))
        except PluginError as error:
            yield f"with {team}: {error}"


def _speaks_in_metres(candidate: _Candidate, frames: list[_Frame]) -> Iterator[str]:
    """Boxes lie where robots can be, and are as large as things are; guards are sent where they may be."""
    answer = candidate.make()
    if candidate.seam is PATROLS:
        for frame in frames:
            point = answer(copy.deepcopy(frame))[0][0]
            if np.hypot(*(candidate.points - point).T).min() > NEAR_M:
                yield (
                    f"it sends a guard to ({point[0]:.3g}, {point[1]:.3g}) m, where none may be: give one of "
                    "the points that it was made of"
                )
                return
        return
    x_min, y_min, x_max, y_max = candidate.prior_map.extent
    for frame in frames:
        for box in np.concatenate(answer(copy.deepcopy(frame))):
            width, height = box[2:] - box[:2]
            if max(width, height) > LARGEST_M:
                yield f"a box of {width:.3g} x {height:.3g} m: are these metres?"
                return
            if (
                box[0] < x_min - OFF_MAP_M
                or box[1] < y_min - OFF_MAP_M
                or box[2] > x_max + OFF_MAP_M
                or box[3] > y_max + OFF_MAP_M
            ):
                yield (
                    f"a box at ({box[0]:.3g}, {box[1]:.3g}) m is off the map, which is from ({x_min:.3g}, "
                    f"{y_min:.3g}) to ({x_max:.3g}, {y_max:.3g}) m: is it in the map frame?"
                )
                return


def _time_ms(candidate: _Candidate, frames: list[_Frame]) -> float:
    answer, times = candidate.make(), []
    for frame in frames:
        start_s = time.perf_counter()
        answer(frame)
        times.append(time.perf_counter() - start_s)
    return 1e3 * statistics.median(times)


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


def _arrays(frame: _Frame) -> list[Any]:
    """Everything in a frame that could be written to."""
    arrays: list[Any] = list(frame.found)
    for one in frame.observations:
        arrays += [one.costmap.data, np.array(one.pose)]
        if one.scan is not None:
            arrays += [one.scan.ranges_m, np.array(one.scan.pose)]
    return arrays


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
