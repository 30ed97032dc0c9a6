"""The trials of a labyrinth campaign as numbers, sorted into cells, and their means with intervals."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from midnet_bench.analysis import statistics
from midnet_bench.analysis.statistics import Estimate
from midnet_bench.campaign.store import Store, StoredTrial
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.rng import stream

GUARD, INTRUDER = "guard", "intruder"


@dataclass(frozen=True)
class RobotHealth:
    """How one robot fared while it was in the arena."""

    role: str
    present_s: float
    row: Row
    """its row of the ``robots`` table"""

    @property
    def stuck_percent(self) -> float:
        """The share of its time that it was stuck, percent."""
        return 100.0 * number(self.row["stuck_s"]) / self.present_s if self.present_s > 0.0 else math.nan

    @property
    def metres_per_minute(self) -> float:
        """What it drove, over the time that it was there."""
        return 60.0 * number(self.row["distance_m"]) / self.present_s if self.present_s > 0.0 else math.nan


@dataclass(frozen=True)
class LabyrinthTrial:
    """One finished trial."""

    seed: int
    intruders: int
    robots: int
    success_rate: float
    """Eq. 11, percent"""
    detected_not_caught: float
    """percent of the intruders"""
    detection_times_s: tuple[float, ...]
    """of the intruders that were detected, seconds from the start"""
    capture_times_s: tuple[float, ...]
    """of those that were caught"""
    simulated_s: float
    wall_s: float
    health: tuple[RobotHealth, ...]

    def mean_health(self, role: str, value: Callable[[RobotHealth], float]) -> float:
        """The mean of ``value`` over the robots of one role."""
        values = [value(robot) for robot in self.health if robot.role == role]
        return sum(values) / len(values) if values else math.nan


Cells = Mapping[tuple[int, int], Sequence[LabyrinthTrial]]
"""(intruders, security robots) -> finished trials, seeds ascending"""


def variants_of(store: Store) -> dict[str, Cells]:
    """The finished trials by the values of the grid's other factors (``capture=within``), then by cell.

    A campaign that varies nothing but the two numbers has one variant, named by the empty text.
    """
    variants: dict[str, dict[tuple[int, int], list[LabyrinthTrial]]] = {}
    for stored in store.trials():
        if stored.status == "finished":
            cell = store.definition.cell_of(stored.parameters)
            others = [
                f"{name}={value}" for name, value in cell.items() if name not in ("intruders", "robots")
            ]
            trial = _trial(stored)
            cells = variants.setdefault(", ".join(others), {})
            cells.setdefault((trial.intruders, trial.robots), []).append(trial)
    return {name: dict(sorted(cells.items())) for name, cells in variants.items()}


def intruder_counts(cells: Cells) -> list[int]:
    """The numbers of intruders that there are, ascending."""
    return sorted({intruders for intruders, _ in cells})


def team_sizes(cells: Cells) -> list[int]:
    """The numbers of security robots that there are, ascending."""
    return sorted({robots for _, robots in cells})


def rates_by_seed(cells: Cells, intruders: int | None, robots: int) -> dict[int, float]:
    """Success rate by seed for a team size; over all numbers of intruders if ``intruders`` is None.

    Trials of one seed share their intruders whatever their number, so over all numbers the seed is the
    unit: the mean of its rates, for the seeds at which every number of intruders has finished.
    """
    if intruders is not None:
        return {trial.seed: trial.success_rate for trial in cells.get((intruders, robots), ())}
    return seed_means(cells, robots, lambda trial: trial.success_rate)


def seed_means(cells: Cells, robots: int, value: Callable[[LabyrinthTrial], float]) -> dict[int, float]:
    """The mean of ``value`` over all numbers of intruders by seed; seeds that lack one are left out."""
    counts = intruder_counts(cells)
    by_seed: dict[int, list[float]] = {}
    for count in counts:
        for trial in cells.get((count, robots), ()):
            by_seed.setdefault(trial.seed, []).append(value(trial))
    complete = {seed: values for seed, values in by_seed.items() if len(values) == len(counts)}
    defined = {seed: [v for v in values if not math.isnan(v)] for seed, values in complete.items()}
    return {seed: sum(values) / len(values) for seed, values in defined.items() if values}


def mean(values: Iterator[float] | Sequence[float], *purpose: str | int) -> Estimate:
    """The mean over trials (or seeds) with its 95 % bootstrap interval; ``purpose`` seeds the bootstrap."""
    return statistics.mean(list(values), stream(0, "bootstrap", *purpose))


def pooled_time(trials: Sequence[LabyrinthTrial], times: str) -> Estimate:
    """The mean of ``capture_times_s`` or ``detection_times_s`` over intruders, seconds; trials drawn whole.

    It is the mean of those that were caught (or detected) alone, so a team that catches the hard ones
    too may look slower; trials that caught nobody have no part in it.
    """
    each: list[tuple[float, ...]] = [values for trial in trials if (values := getattr(trial, times))]
    return statistics.ratio_of_sums(
        [math.fsum(values) for values in each],
        [len(values) for values in each],
        stream(0, "bootstrap", times),
    )


def number(value: Scalar) -> float:
    """A table's cell as a number; None is NaN."""
    return math.nan if value is None else float(value)


def _trial(stored: StoredTrial) -> LabyrinthTrial:
    tables = stored.tables
    (row,) = tables["trial"]
    intruders = int(number(stored.parameters["intruders"]))
    duration_s = number(row["duration_s"])
    times = {name: [number(fate[name]) for fate in tables["intruders"]] for name in _TIMES}
    present_s = iter(
        min((at_s for at_s in ends if not math.isnan(at_s)), default=duration_s)
        for ends in zip(times["caught_at_s"], times["escaped_at_s"], strict=True)
    )
    return LabyrinthTrial(
        seed=stored.seed,
        intruders=intruders,
        robots=int(number(stored.parameters["robots"])),
        success_rate=number(row["success_rate"]),
        detected_not_caught=100.0 * (number(row["detected"]) - number(row["caught"])) / intruders,
        detection_times_s=tuple(at_s for at_s in times["detected_at_s"] if not math.isnan(at_s)),
        capture_times_s=tuple(at_s for at_s in times["caught_at_s"] if not math.isnan(at_s)),
        simulated_s=stored.simulated_s or duration_s,
        wall_s=stored.wall_s,
        health=tuple(
            RobotHealth(GUARD, duration_s, robot)
            if robot["role"] == GUARD
            else RobotHealth(INTRUDER, next(present_s), robot)
            for robot in tables["robots"]
        ),
    )


_TIMES = ("detected_at_s", "caught_at_s", "escaped_at_s")
