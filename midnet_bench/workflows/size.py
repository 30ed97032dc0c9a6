"""``size``: the smallest team that finds, or catches, an intruder in time with a probability.

Each team size is a campaign of the labyrinth test with one intruder, on the same seeds; a sequential test
says after each batch of trials whether its probability is above the threshold.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from midnet_bench.analysis.frames import load_results
from midnet_bench.analysis.sample_size import ALPHA, BATCH, SequentialTest
from midnet_bench.analysis.statistics import Estimate
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.arena.arena import Arena, load_arena
from midnet_bench.arena.free_space import GOAL_CLEARANCE_M, doors, free_space
from midnet_bench.arena.layout import place
from midnet_bench.campaign import definition, runner
from midnet_bench.campaign.definition import Campaign
from midnet_bench.campaign.store import FILE_NAME
from midnet_bench.campaign.trial import Scalar
from midnet_bench.errors import InputError, MidnetBenchError
from midnet_bench.experiments import registry
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.geometry import Point, lengths
from midnet_bench.io.files import write_atomically
from midnet_bench.workflows.arena_faults import check
from midnet_bench.workflows.campaigns import run_campaign

MOST_ROBOTS = 20
MOST_TRIALS = 400  # of each team size, unless others are given
USUAL_ESCAPE_M = 12.0
NOWHERE = Path("/nonexistent")  # the folder of a plan that goes by no earlier trials
OWN_KEYS = ("robots", "intruders", "time_limit_s", "start_at", "escape_at", "ends")
"""parameters that the question itself decides"""


@dataclass(frozen=True)
class Question:
    """How many robots for a building."""

    arena: str  # a packaged arena, or a YAML file
    within_s: float = 60.0
    """counted from the instant when the intruder stands at its entrance and the guards at their starts"""
    probability: float = 0.9
    capture: bool = False  # whether the intruder is to be caught, not only found
    entrances: str | None = None
    """``doors``, ``anywhere``, or places ``X,Y``; None: doors if the outer wall has a gap, else anywhere"""
    parameters: Mapping[str, Scalar] = field(default_factory=dict)  # further parameters of the labyrinth test
    most_trials: int = MOST_TRIALS
    base_seed: int = 1

    def __post_init__(self) -> None:
        """Raises InputError: a number is out of range, or the question decides a parameter itself."""
        if not 0.0 < self.within_s <= 3600.0:
            raise InputError(f"--within {self.within_s:g}: above 0 and at most 3600 seconds")
        if not 0.0 < self.probability < 1.0:
            raise InputError(f"--probability {self.probability:g}: above 0 and below 1")
        if self.most_trials < BATCH or self.most_trials % BATCH:
            raise InputError(f"--trials {self.most_trials}: a multiple of {BATCH}")
        if own := [key for key in OWN_KEYS if key in self.parameters]:
            raise InputError(f"--set {own[0]}: 'size' decides it; leave it out")

    @property
    def done(self) -> str:
        """What happens to an intruder in time: ``found`` or ``caught``."""
        return "caught" if self.capture else "found"

    def guards(self, robots: int) -> str:
        """``4 guards find``, ``1 guard catches``."""
        if robots == 1:
            return f"1 guard {'catches' if self.capture else 'finds'}"
        return f"{robots} guards {'catch' if self.capture else 'find'}"


class Team(NamedTuple):
    """One team size and its trials."""

    robots: int
    time_s: dict[int, float]  # seed -> when the intruder was found or caught; NaN if it was not in time
    probability: Estimate
    is_enough: bool | None  # None: the most trials cannot tell


class Answer(NamedTuple):
    """What the trials say."""

    question: Question
    teams: list[Team]  # those that were tried, in order of their size
    entrances: dict[int, Point]  # seed -> where the intruder started, metres, map frame

    @property
    def smallest(self) -> Team | None:
        """The smallest team that is enough; None if none is."""
        return next((team for team in self.teams if team.is_enough), None)

    @property
    def sentences(self) -> list[str]:
        """The answer, what the next smaller team does, and what it stands on."""
        best, last = self.smallest, self.teams[-1]
        shown = best or last
        end = f": no team of up to {last.robots}, the most that start there, is enough."
        if best is not None:
            fewer = [team for team in self.teams if team.robots == best.robots - 1]
            do = "does" if best.robots == 2 else "do"
            end = "".join(f"; {team.robots} {do} with {_text(team.probability)}" for team in fewer) + "."
        return [
            f"{self.question.guards(shown.robots)} an intruder within {self.question.within_s:g} s with "
            f"probability {_text(shown.probability)}{end}",
            *(
                f"{team.probability.n} trials cannot tell whether {team.robots} are enough: "
                f"{_text(team.probability)}."
                for team in self.teams
                if team.is_enough is None
            ),
            f"Intervals hold 95 %; a team is called enough, or not, wrongly with a probability of at most "
            f"{100 * ALPHA:g} %.",
        ]

    @property
    def table(self) -> Table:
        """A row for each team size that was tried."""
        rows: list[Mapping[str, Cell]] = [
            {
                "robots": team.robots,
                "trials": team.probability.n,
                "successes": sum(not math.isnan(time_s) for time_s in team.time_s.values()),
                "probability": team.probability,
                "median_s": _median([*team.time_s.values()]),
                "enough": {True: "yes", False: "no", None: "open"}[team.is_enough],
            }
            for team in self.teams
        ]
        title = f"Intruders {self.question.done} within {self.question.within_s:g} s"
        return Table("size", title, rows, {"probability": 2, "median_s": 1}, labels={"median_s": "median, s"})

    @property
    def places(self) -> Table:
        """A row for each entrance: how the smallest team that is enough, else the largest, fares there."""
        team = self.smallest or self.teams[-1]
        by_place: dict[Point, list[float]] = {}
        for seed, time_s in team.time_s.items():
            by_place.setdefault(self.entrances[seed], []).append(time_s)
        rows: list[Mapping[str, Cell]] = [
            {
                "x_m": x,
                "y_m": y,
                "trials": len(times_s),
                "share": sum(not math.isnan(one) for one in times_s) / len(times_s),
                "median_s": _median(times_s),
            }
            for (x, y), times_s in sorted(by_place.items())
        ]
        return Table("entrances", f"Where intruders start, and {team.robots} guards", rows, {"share": 2})


def ask(question: Question) -> tuple[Question, Arena, list[str]]:
    """The question with its entrances decided, its building, checked, and what to know about that.

    Raises:
        InputError: the building cannot be read, or cannot be guarded: a room that no robot reaches.
    """
    found = check(load_arena(question.arena))
    # one intruder at an entrance needs no room for the arena's own
    rooms = [fault.text for fault in found.faults if not fault.text.startswith("mobile_intruders")]
    if rooms:
        more = f" (and {len(rooms) - 1} more: 'midnet-bench arena check')" if len(rooms) > 1 else ""
        raise InputError(f"{question.arena}: cannot be guarded: {rooms[0]}{more}")
    notes = [
        f"no robot can enter {closed.area_m2:.1f} m2 of floor at ({closed.at[0]:.2f}, {closed.at[1]:.2f}):"
        " is it outside the building?"
        for closed in found.closed
        if not closed.is_declared
    ]
    if question.entrances is None:
        try:
            doors(found.arena)
            question = replace(question, entrances="doors")
        except InputError:
            question = replace(question, entrances="anywhere")
            notes.append("the outer wall has no gap: intruders start anywhere")
    try:
        _entrances_of(question)
    except InputError as error:
        where = str(error).removeprefix("parameters: ").replace("start_at", "--intruders")
        raise InputError(f"{question.arena}: cannot be guarded: {where}") from error
    return question, found.arena, notes


def _entrances_of(question: Question) -> list[Point]:
    """Raises InputError."""
    start_at = question.entrances or "anywhere"
    return LabyrinthParameters.of(arena=question.arena, start_at=start_at, escape_distance_m=0.0).entrances


def campaign_of(question: Question, arena: Arena, robots: int, trials: int) -> Campaign:
    """The trials of one team size. Raises InputError: a parameter is no good."""
    places = _entrances_of(question)
    floor = free_space(arena, GOAL_CLEARANCE_M).grid
    rows, columns = np.nonzero(floor.data)
    cells = np.stack((floor.x_centers[columns], floor.y_centers[rows]), axis=-1)
    starts = np.array(places) if places else cells[:: max(1, len(cells) // 200)]
    # its way leads through at least half of the building, wherever it starts
    far_m = min(float(lengths(cells - start).max()) for start in starts)
    parameters: dict[str, Scalar] = {
        **{"engine": "fast", "arena": question.arena, "robots": robots, "intruders": 1},
        "start_at": question.entrances or "anywhere",
        "escape_distance_m": round(min(USUAL_ESCAPE_M, far_m / 2.0), 2),
        "time_limit_s": question.within_s,
        **({} if question.capture else {"capture": "detected"}),
        **question.parameters,
    }
    values = {"experiment": "labyrinth", "name": f"robots-{robots}", "parameters": parameters}
    return definition.parse_campaign({**values, "trials": trials, "base_seed": question.base_seed}, "size")


def cost_of(question: Question, arena: Arena, jobs: int | None = None) -> tuple[float, float]:
    """Estimated wall time of a search that is clear at once, and of one that is never clear, seconds."""

    def wall_s(sizes: Sequence[int], trials: int) -> float:
        asked = [campaign_of(question, arena, robots, trials) for robots in sizes]
        return math.fsum(
            runner.plan(definition.resolve(one, registry), NOWHERE, jobs=jobs).wall_s for one in asked
        )

    return wall_s((1, 2, 4, 3), BATCH), wall_s((1, 2, 4, 8, 6, 5), question.most_trials)


def _fits(question: Question, arena: Arena, robots: int) -> bool:
    """Whether a team has room at its starts, and the intruder beside it, in the first trials."""
    first, intruders = question.base_seed, int(question.entrances == "anywhere")
    try:
        for seed in range(first, first + BATCH):
            place(arena, seed, robots, intruders)
    except InputError:
        return False
    return True


def size(
    question: Question,
    arena: Arena,
    directory: Path,
    *,
    jobs: int | None = None,
    fresh: bool = False,
    note: Callable[[str], None] = lambda text: None,
) -> Answer:
    """Try teams of 1, 2, 4, 8 ... guards, then those between the last two; a size at a time.

    Args:
        question: of :func:`ask`.
        arena: of :func:`ask`.
        directory: a folder for each team size goes there; trials that are there are not run again.
        jobs: worker processes, all cores unless given.
        fresh: run all trials anew.
        note: receives a line after each batch of trials.

    Raises:
        InputError: a parameter is no good, or a folder has trials of another question.
        MidnetBenchError: a trial failed.
    """
    teams: dict[int, Team] = {}

    def is_enough(robots: int) -> bool:
        teams[robots] = _tried(question, arena, directory / f"robots-{robots}", robots, jobs, fresh, note)
        return teams[robots].is_enough is True

    low, high = 0, 1
    while not is_enough(high):
        larger = range(min(2 * high, MOST_ROBOTS), high, -1)
        most = next((robots for robots in larger if _fits(question, arena, robots)), high)
        if most == high:
            break
        low, high = high, most
    while high - low > 1 and teams[high].is_enough:
        middle = (low + high) // 2
        low, high = (low, middle) if is_enough(middle) else (middle, high)
    starts = _starts(question, arena, max(teams.values(), key=lambda team: len(team.time_s)))
    return Answer(question, [teams[robots] for robots in sorted(teams)], starts)


def _tried(
    question: Question,
    arena: Arena,
    folder: Path,
    robots: int,
    jobs: int | None,
    fresh: bool,
    note: Callable[[str], None],
) -> Team:
    """Run batches of trials of one team size until they can tell, or are the most."""
    test = SequentialTest(question.probability, question.most_trials)
    is_there = (folder / FILE_NAME).exists() and not fresh
    stored, done = load_results(folder).definition.trials if is_there else 0, 0
    for trials in itertools.count(BATCH, BATCH):
        if trials > done:
            begins, done = done == 0, max(trials, stored)
            campaign = campaign_of(question, arena, robots, done)
            outcome = run_campaign(campaign, folder, jobs=jobs, fresh=fresh and begins)
            if outcome.failed:
                reasons = load_results(folder, registry.tables_of).failures["reason"]
                raise MidnetBenchError(f"{folder}: a trial failed: {reasons.iloc[0]}")
        frame = load_results(folder, registry.tables_of).table("intruders")
        frame = frame[frame["seed"] < question.base_seed + trials]
        times_s = dict(zip(frame["seed"].tolist(), frame["caught_at_s"].tolist(), strict=True))
        successes = int(frame["caught_at_s"].notna().sum())
        is_enough = test.decision(successes, trials)
        said = {True: ": enough", False: ": not enough", None: ""}[is_enough]
        note(f"{question.guards(robots)} it in {successes} of {trials} trials{said}")
        if test.is_over(successes, trials):
            return Team(robots, times_s, test.interval(successes, trials), is_enough)
    raise AssertionError


def _starts(question: Question, arena: Arena, team: Team) -> dict[int, Point]:
    """Where the intruder of each seed starts; no team size changes it."""
    from midnet_bench.experiments.labyrinth.trial import layout_of

    campaign = campaign_of(question, arena, team.robots, BATCH)
    parameters = LabyrinthParameters.parse(campaign.parameters, "size").with_files_read()
    found = {}
    for seed in team.time_s:
        (pose,) = layout_of(parameters, seed).intruders
        found[seed] = (pose.x, pose.y)
    return found


def write(answer: Answer, arena: Arena, directory: Path) -> list[Path]:
    """Write the tables and both figures into a folder; their paths."""
    from midnet_bench.drawing.charts import chart_files, entrances_figure, times_figure

    written = [*answer.table.write(directory), *answer.places.write(directory)]
    question = answer.question
    times_s = {team.robots: [*team.time_s.values()] for team in answer.teams}
    team = answer.smallest or answer.teams[-1]
    places = pd.DataFrame([dict(row) for row in answer.places.rows])
    outlines = [solid.outline for solid in (*arena.wall_solids(), *arena.placed_solids())]
    figures = {
        "probability_over_time": times_figure(
            times_s, question.within_s, question.probability, question.done
        ),
        "entrances": entrances_figure(outlines, places, team.robots, question.within_s, question.done),
    }
    for name, figure in figures.items():
        for ending, content in chart_files(figure).items():
            write_atomically(directory / f"{name}{ending}", content)
            written.append(directory / f"{name}{ending}")
    return written


def _median(times_s: list[float]) -> float:
    """NaN if half of the trials have no time; those without one are later than all others."""
    middle = float(np.median([math.inf if math.isnan(one) else one for one in times_s]))
    return middle if math.isfinite(middle) else math.nan


def _text(one: Estimate) -> str:
    return f"{one.value:.2f} [{one.low:.2f}, {one.high:.2f}]"
