"""The trials of a labyrinth campaign as data frames, sorted into cells, and their means with intervals."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import Estimate, exact_mean, exact_sum

GUARD, INTRUDER = "guard", "intruder"
CELL = ["intruders", "robots"]
TRIAL = [*CELL, "seed"]


@dataclass(frozen=True)
class Variant:
    """The finished trials under one choice of the grid's factors beside the two numbers."""

    factors: dict[str, object]
    """that choice"""
    trials: pd.DataFrame
    """A row per trial, by ``intruders``, ``robots`` (security robots) and ``seed``.

    ``success_rate`` (Eq. 11) and ``detected_not_caught`` in percent of the intruders, ``simulated_s`` and
    ``wall_s``; of the intruders that were detected or caught ``detection_times`` and ``capture_times`` (how
    many) and ``detection_times_s`` and ``capture_times_s`` (their sums, seconds from the start)."""
    robots: pd.DataFrame
    """A row per robot and trial: its row of the table ``robots``, ``present_s`` (its time in the arena),
    ``stuck_percent`` of that time, and ``metres_per_minute``."""

    @cached_property
    def intruder_counts(self) -> list[int]:
        """The numbers of intruders that there are, ascending."""
        return sorted(self.trials["intruders"].unique().tolist())

    @cached_property
    def team_sizes(self) -> list[int]:
        """The numbers of security robots that there are, ascending."""
        return sorted(self.trials["robots"].unique().tolist())

    def cells(self) -> list[tuple[int, int, pd.DataFrame]]:
        """(intruders, security robots, their trials) in ascending order."""
        return [
            (intruders, robots, cell)
            for intruders in self.intruder_counts
            for robots in self.team_sizes
            if len(cell := self.cell(intruders, robots))
        ]

    def cell(self, intruders: int, robots: int) -> pd.DataFrame:
        """The trials of one cell, which may be none."""
        is_there = (self.trials["intruders"] == intruders) & (self.trials["robots"] == robots)
        return self.trials[is_there]

    def rates_by_seed(self, intruders: int | None, robots: int) -> dict[int, float]:
        """Success rate by seed for a team size; over all numbers of intruders if ``intruders`` is None.

        Trials of one seed share their intruders whatever their number, so over all numbers the seed is the
        unit: the mean of its rates, for the seeds at which every number of intruders has finished.
        """
        if intruders is not None:
            return _by_seed(self.cell(intruders, robots), "success_rate", 1)
        return self._over_intruders(self.trials, robots, "success_rate")

    def health_by_seed(self, role: str, robots: int, column: str) -> dict[int, float]:
        """The mean of a column of ``robots`` over the robots of one role, as :meth:`rates_by_seed`."""
        mine = self.robots[(self.robots["role"] == role) & (self.robots["robots"] == robots)]
        return self._over_intruders(_means(mine, TRIAL, column), robots, column)

    def success(self, intruders: int | None, robots: int) -> Estimate:
        """The mean success rate of a cell, percent; over all numbers of intruders if that is None."""
        return _percent(self.rates_by_seed(intruders, robots).values())

    def not_caught(self, intruders: int, robots: int) -> Estimate:
        """The mean share of intruders that were detected and yet not caught, percent."""
        return _percent(self.cell(intruders, robots)["detected_not_caught"])

    def pooled_time(self, intruders: int, robots: int, times: str) -> Estimate:
        """The mean of ``capture_times`` or ``detection_times`` over intruders, seconds; trials are the unit.

        It is the mean of those that were caught (or detected) alone, so a team that catches the hard ones
        too may look slower; trials without a capture have no part in it.
        """
        cell = self.cell(intruders, robots)
        cell = cell[cell[times] > 0]
        times_s, number = cell[f"{times}_s"].tolist(), cell[times].tolist()
        return statistics.ratio_of_sums(times_s, number, within=(0.0, math.inf))

    def duration(self, confidence: float = 0.95) -> Estimate:
        """How long a trial takes, simulated seconds, mean over all cells; seeds are the unit."""
        durations_s = [*self.all_cells_by_seed("duration_s").values()]
        return statistics.mean(durations_s, confidence, within=(0.0, math.inf))

    def all_cells_by_seed(self, column: str) -> dict[int, float]:
        """The mean of a column of ``trials`` over all cells by seed; seeds that lack a cell are left out."""
        return _by_seed(self.trials, column, len(self.intruder_counts) * len(self.team_sizes))

    def capture_time_by_seed(self) -> dict[int, float]:
        """Seconds from the start, mean over a seed's caught intruders; seeds without any are left out."""
        times_s, times = (_by_seed(self.trials, name) for name in ("capture_times_s", "capture_times"))
        return {seed: times_s[seed] / count for seed, count in times.items() if count}

    def health(self, role: str, robots: int, column: str) -> Estimate:
        """The mean of a column of ``robots`` over seeds, all numbers of intruders together."""
        values = self.health_by_seed(role, robots, column).values()
        return statistics.mean(list(values), within=(0.0, math.inf))

    def _over_intruders(self, trials: pd.DataFrame, robots: int, column: str) -> dict[int, float]:
        return _by_seed(trials[trials["robots"] == robots], column, len(self.intruder_counts))


def variants_of(results: Results) -> dict[str, Variant]:
    """The finished trials by the values of the grid's other factors (``capture=within``).

    A campaign that varies nothing but the two numbers has one variant, named by the empty text.
    """
    return results.once(_variants)


def variants_side_by_side(campaigns: Mapping[str, Results]) -> dict[str, Variant]:
    """Those of several campaigns, named by both."""
    return {
        f"{campaign}: {name}" if name else campaign: variant
        for campaign, results in campaigns.items()
        for name, variant in variants_of(results).items()
    }


def _variants(results: Results) -> dict[str, Variant]:
    trials = results.table("trial")
    if trials.empty:
        return {}
    trials, robots = _trials(results, trials), _robots(results, trials)
    return {
        str(name): Variant(
            {name: cell[name].tolist()[0] for name in results.factors if name not in CELL},
            cell.sort_values(CELL, kind="stable"),
            robots[robots["variant"] == name].sort_values(CELL, kind="stable"),
        )
        for name, cell in trials.groupby("variant", sort=False)
    }


def _percent(values: Iterable[float]) -> Estimate:
    """The mean of percentages over trials (or seeds), each a share of the intruders, with its interval."""
    one = statistics.share([value / 100.0 for value in values])
    return Estimate(100.0 * one.value, 100.0 * one.low, 100.0 * one.high, one.n)


def _trials(results: Results, trials: pd.DataFrame) -> pd.DataFrame:
    keys = [*results.factors, "seed"]
    placed = _placed(results, trials)
    fates = results.table("intruders")
    for times, column in (("detection_times", "detected_at_s"), ("capture_times", "caught_at_s")):
        groups = fates.groupby(keys, sort=False, dropna=False)[column]
        placed = placed.join(groups.count().rename(times), on=keys)
        placed = placed.join(
            groups.agg(lambda values: exact_sum(values.dropna())).rename(f"{times}_s"), on=keys
        )
    placed = placed.join(results.timing.set_index(keys)[["simulated_s", "wall_s"]], on=keys)
    missed = placed["detected"] - placed["caught"]
    return placed.assign(
        detected_not_caught=100.0 * missed / placed["intruders"],
        simulated_s=placed["simulated_s"].fillna(placed["duration_s"]),
    )


def _robots(results: Results, trials: pd.DataFrame) -> pd.DataFrame:
    """A robot's time in the arena ends when it is taken out, or with the trial."""
    keys = [*results.factors, "seed"]
    robots, fates = _placed(results, results.table("robots")), results.table("intruders")
    ends = fates[keys].assign(
        role=INTRUDER,
        number=fates.groupby(keys).cumcount(),
        present_s=fates["left_at_s"],
    )
    robots = robots.assign(number=robots.groupby([*keys, "role"]).cumcount())
    robots = robots.merge(ends, how="left", on=[*keys, "role", "number"])
    robots = robots.join(trials.set_index(keys)["duration_s"], on=keys)
    present_s = robots["present_s"].fillna(robots["duration_s"])
    defined_s = present_s.where(present_s > 0.0)
    return robots.assign(
        present_s=present_s,
        stuck_percent=100.0 * robots["stuck_s"] / defined_s,
        metres_per_minute=60.0 * robots["distance_m"] / defined_s,
    )


def _placed(results: Results, frame: pd.DataFrame) -> pd.DataFrame:
    """A table with its variant and the two numbers, whether or not they are factors of the grid."""
    return frame.assign(
        variant=results.other_factors(frame, *CELL),
        **{name: results.whole_numbers(frame, name) for name in CELL},
    )


def _by_seed(frame: pd.DataFrame, column: str, rows: int | None = None) -> dict[int, float]:
    """The mean of a column by seed, where it is known; of seeds with so many rows alone, if that is given."""
    if rows is not None:
        frame = frame[frame.groupby("seed")["seed"].transform("size") == rows]
    means = _means(frame.dropna(subset=[column]), ["seed"], column)
    return dict(zip(means["seed"].tolist(), means[column].tolist(), strict=True))


def _means(frame: pd.DataFrame, keys: list[str], column: str) -> pd.DataFrame:
    """A row for each group of rows that agree in the keys, in the order of their first rows: keys and mean.

    Of exact sums: pandas' own change with the order of the rows and with its version.
    """
    groups = frame.groupby(keys, sort=False, dropna=False)[column]
    return groups.agg(lambda values: exact_mean(values.tolist())).reset_index()
