"""``size``: the smallest team that finds, or catches, an intruder in time with a probability.

The packaged campaign ``size`` in a user's building: the labyrinth test with one intruder, which stays until
it is found or the time is over, each team size on the same seeds.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.analysis.statistics import SHARE_METHOD, Estimate, share
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.arena.arena import Arena, load_arena
from midnet_bench.arena.free_space import doors
from midnet_bench.campaign.definition import Campaign, Values, load_campaign, override, resolve
from midnet_bench.campaign.runner import Plan, plan
from midnet_bench.campaign.trial import Scalar
from midnet_bench.errors import InputError, MidnetBenchError
from midnet_bench.experiments import registry
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.geometry import Point
from midnet_bench.io.files import write_atomically
from midnet_bench.workflows.arena_faults import check as checked_arena
from midnet_bench.workflows.arena_faults import shown_place
from midnet_bench.workflows.campaigns import campaign_file, run_resolved

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CAMPAIGN = "size"  # the packaged campaign
MORE_ROBOTS, MORE_TRIALS = 3, 4  # added to the largest team, and times the trials, in what is advised next
OWN_KEYS = ("robots", "intruders", "time_limit_s", "start_at", "escape_at", "at_escape", "ends")
"""parameters that the question itself decides"""

IS_ENOUGH = {True: "yes", False: "no", None: "open"}
WORDS = {True: "enough", False: "not enough", None: "open"}


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
    robots: Values | None = None  # the team sizes; those of the packaged campaign unless given
    trials: int | None = None  # of each team size; those of the packaged campaign unless given
    base_seed: int | None = None

    def __post_init__(self) -> None:
        """Raises InputError: a number is out of range, or the question decides a parameter itself."""
        if not 0.0 < self.within_s <= 3600.0:
            raise InputError(f"--within {self.within_s:g}: above 0 and at most 3600 seconds")
        if not 0.0 < self.probability < 1.0:
            raise InputError(f"--probability {self.probability:g}: above 0 and below 1")
        if own := [key for key in OWN_KEYS if key in self.parameters]:
            raise InputError(f"--set {own[0]}: 'size' decides it; leave it out")
        if "capture" in self.parameters and not self.capture:
            raise InputError("--set capture: it says how an intruder is caught; give --capture too")

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
    is_enough: bool | None  # None: the interval holds the wanted probability


class Answer(NamedTuple):
    """What the trials say."""

    question: Question
    teams: list[Team]  # in order of their size
    entrances: dict[int, Point]  # seed -> where the intruder started, metres, map frame

    @property
    def smallest(self) -> Team | None:
        """The smallest team that is enough; None if none is."""
        return next((team for team in self.teams if team.is_enough), None)

    @property
    def shown(self) -> Team:
        """The team that the answer tells of: the smallest that is enough, else the largest."""
        return self.smallest or self.teams[-1]

    @property
    def sentences(self) -> list[str]:
        """The answer with what stays open, what to type next, and what it stands on."""
        question, best, shown = self.question, self.smallest, self.shown
        fewer = [team for team in self.teams if best is None or team.robots < best.robots]
        undecided = [team for team in fewer if team.is_enough is None]
        fact = (
            f"{question.guards(shown.robots)} an intruder within {question.within_s:g} s with probability "
            f"{_text(shown.probability)}"
        )
        if best is None:
            fact = f"No team is {'shown to be ' * bool(undecided)}enough: {fact}"
        elif fewer:
            fact += f"; {fewer[-1].robots} {_do(fewer[-1])} with {_text(fewer[-1].probability)}"
        if undecided:
            which = " or ".join(str(team.robots) for team in undecided)
            fact += f"; whether {which} {'is' if which == '1' else 'are'} enough stays open"
        advice = []
        if undecided:
            trials = MORE_TRIALS * undecided[0].probability.n
            advice.append(f"--trials {trials} makes the intervals half as long.")
        if best is None:
            sizes = [*(team.robots for team in self.teams), shown.robots + MORE_ROBOTS]
            advice.append(f"--robots {','.join(map(str, sizes))} adds a larger team.")
        return [
            f"{fact}.",
            *([" ".join(advice)] if advice else []),
            f"A team is enough where its whole interval is at or above {question.probability:g}, not enough "
            f"where it is below, and open otherwise ({SHARE_METHOD}, for each team by itself).",
        ]

    @property
    def table(self) -> Table:
        """A row for each team size."""
        rows: list[Mapping[str, Cell]] = [
            {
                "robots": team.robots,
                "trials": team.probability.n,
                "successes": sum(not math.isnan(time_s) for time_s in team.time_s.values()),
                "probability": team.probability,
                "median_s": _median([*team.time_s.values()]),
                "enough": IS_ENOUGH[team.is_enough],
            }
            for team in self.teams
        ]
        title = f"Intruders {self.question.done} within {self.question.within_s:g} s"
        return Table("size", title, rows, {"probability": 2, "median_s": 1}, labels={"median_s": "median, s"})

    @property
    def places(self) -> Table:
        """A row for each entrance: how the team :attr:`shown` fares there."""
        by_place: dict[Point, list[float]] = {}
        for seed, time_s in self.shown.time_s.items():
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
        title = f"Where intruders start, and {self.shown.robots} guards"
        return Table("entrances", title, rows, {"share": 2})


def ask(question: Question) -> tuple[Question, Arena, list[str]]:
    """The question with its entrances decided, its building, checked, and what to know about that.

    Raises:
        InputError: the building cannot be read, or cannot be guarded: a room that no robot reaches.
    """
    found = checked_arena(load_arena(question.arena))
    # one intruder at an entrance needs no room for the arena's own
    rooms = [fault.text for fault in found.faults if not fault.text.startswith("mobile_intruders")]
    if rooms:
        more = f" (and {len(rooms) - 1} more: 'midnet-bench arena check')" if len(rooms) > 1 else ""
        raise InputError(f"{question.arena}: cannot be guarded: {rooms[0]}{more}")
    notes = [
        f"no robot can enter {closed.area_m2:.1f} m2 of floor at {shown_place(closed.at)}: is it outside the"
        " building?"
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
        place = {"arena": question.arena, "start_at": question.entrances, "escape_distance_m": 0.0}
        _ = LabyrinthParameters.of(**place).entrances
    except InputError as error:
        where = str(error).removeprefix("parameters: ").replace("start_at", "--intruders")
        raise InputError(f"{question.arena}: cannot be guarded: {where}") from error
    return question, found.arena, notes


def campaign_of(question: Question) -> Campaign:
    """The packaged campaign with what the question asks for. Raises InputError: a parameter is no good."""
    changes: dict[str, Values] = {
        "arena": question.arena,
        "start_at": question.entrances or "anywhere",
        "time_limit_s": question.within_s,
        **({} if question.robots is None else {"robots": question.robots}),
        **({"capture": "within"} if question.capture else {}),
        **question.parameters,
    }
    packaged = load_campaign(campaign_file(CAMPAIGN))
    return override(packaged, changes, trials=question.trials, base_seed=question.base_seed)


def plan_of(question: Question, directory: Path, jobs: int | None = None, fresh: bool = False) -> Plan:
    """What :func:`size` would run. Raises InputError as that does."""
    return plan(resolve(campaign_of(question), registry), directory, jobs=jobs, fresh=fresh)


def size(
    question: Question, directory: Path, *, jobs: int | None = None, fresh: bool = False, **more: Any
) -> Answer:
    """Run the campaign of a question, or what is left of it, and answer.

    Args:
        question: of :func:`ask`.
        directory: for the campaign's store; trials that are there are not run again.
        jobs: worker processes, all cores unless given.
        fresh: run all trials anew.
        more: ``compiling`` and ``progress`` of :func:`workflows.campaigns.run_resolved`.

    Raises:
        InputError: a parameter is no good, or the folder has trials of another question.
        MidnetBenchError: a trial failed.
    """
    more |= {"jobs": jobs, "backend": "loky", "fresh": fresh, "retry_failed": False}
    outcome = run_resolved(resolve(campaign_of(question), registry), directory, **more)
    results = load_results(directory, registry.tables_of)
    if outcome.failed:
        raise MidnetBenchError(f"{directory}: a trial failed: {results.failures['reason'].iloc[0]}")
    return answer(question, results)


def answer(question: Question, results: Results) -> Answer:
    """What the finished trials of a campaign say."""
    frame = results.table("intruders")
    teams = []
    for robots, own in frame.groupby("robots"):
        times_s = dict(zip(own["seed"].tolist(), own["caught_at_s"].tolist(), strict=True))
        estimate = share([float(not math.isnan(time_s)) for time_s in times_s.values()])
        is_enough = None
        if estimate.low >= question.probability or estimate.high < question.probability:
            is_enough = estimate.low >= question.probability
        teams.append(Team(int(str(robots)), times_s, estimate, is_enough))
    found = Answer(question, teams, {})
    return found._replace(entrances=_starts(results, found.shown))


def _starts(results: Results, team: Team) -> dict[int, Point]:
    """Where the intruder of each seed of a team starts."""
    from midnet_bench.experiments.labyrinth.trial import layout_of

    definition = results.definition
    settings = definition.parameters_of({"robots": team.robots})
    parameters = LabyrinthParameters.from_flat(settings)
    found = {}
    for seed in team.time_s:
        (pose,) = layout_of(parameters, seed).intruders
        found[seed] = (pose.x, pose.y)
    return found


def figures(answer: Answer, arena: Arena) -> dict[str, "Figure"]:
    """Stem of its files -> the share of intruders found over time, and how long they take by their start."""
    from midnet_bench.drawing.charts import entrances_figure, times_figure

    question = answer.question
    curves = {
        f"{team.robots} guard{'s' * (team.robots != 1)}: {WORDS[team.is_enough]}": (
            [*team.time_s.values()],
            team.probability,
        )
        for team in answer.teams
    }
    places = pd.DataFrame([dict(row) for row in answer.places.rows])
    outlines = [solid.outline for solid in (*arena.wall_solids(), *arena.placed_solids())]
    return {
        "probability_over_time": times_figure(curves, question.within_s, question.probability, question.done),
        "entrances": entrances_figure(
            outlines, places, answer.shown.robots, question.within_s, question.done
        ),
    }


def write(answer: Answer, arena: Arena, directory: Path) -> list[Path]:
    """Write the tables and both figures into a folder; their paths."""
    from midnet_bench.drawing.charts import chart_files

    written = [*answer.table.write(directory), *answer.places.write(directory)]
    for name, figure in figures(answer, arena).items():
        for ending, content in chart_files(figure).items():
            write_atomically(directory / f"{name}{ending}", content)
            written.append(directory / f"{name}{ending}")
    return written


def _median(times_s: list[float]) -> float:
    """NaN if half of the trials have no time; those without one are later than all others."""
    middle = float(np.median([math.inf if math.isnan(one) else one for one in times_s]))
    return middle if math.isfinite(middle) else math.nan


def _do(team: Team) -> str:
    return "does" if team.robots == 1 else "do"


def _text(one: Estimate) -> str:
    return f"{one.value:.2f} [{one.low:.2f}, {one.high:.2f}]"
