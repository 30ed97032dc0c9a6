"""The trials of a labyrinth campaign as data frames, sorted into cells, and their means with intervals."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from weakref import WeakKeyDictionary

import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.statistics import NOT_NEGATIVE, Estimate, Range, exact_mean, exact_sum

GUARD, INTRUDER = "guard", "intruder"
CELL = ["intruders", "robots"]


@dataclass(frozen=True)
class Variant:
    """The finished trials under one choice of the grid's factors beside the two numbers."""

    factors: dict[str, object]  # that choice
    trials: pd.DataFrame
    """A row per trial, by ``intruders``, ``robots`` (security robots) and ``seed``: its row of the table
    ``trial``, ``detected_not_caught`` (percent), ``simulated_s`` and ``wall_s``; of the intruders that were
    detected or caught ``detection_times`` and ``capture_times`` (how many) and ``detection_times_s`` and
    ``capture_times_s`` (their sums, seconds from the start)."""
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
        return [(*key, cell) for key, cell in self.trials.groupby(CELL)]  # type: ignore[misc]

    def by_seed(
        self,
        column: str,
        intruders: int | None = None,
        robots: int | None = None,
        of: pd.DataFrame | None = None,
    ) -> dict[int, float]:
        """The mean of a column by seed, over all numbers of intruders or team sizes that are not given.

        Trials of one seed share their intruders whatever their number, so over several cells the seed is the
        unit, and only seeds at which all of them have finished count. ``of``: rows instead of ``trials``.
        """
        rows, cells = self.trials if of is None else of, 1
        for name, number, numbers in zip(
            CELL, (intruders, robots), (self.intruder_counts, self.team_sizes), strict=True
        ):
            if number is None:
                cells *= len(numbers)
            else:
                rows = rows[rows[name] == number]
        return _by_seed(rows[rows.groupby("seed")["seed"].transform("size") == cells], column)

    def percent(self, column: str, intruders: int | None, robots: int) -> Estimate:
        """The mean over seeds of a percentage of the intruders, with its interval."""
        values = self.by_seed(column, intruders, robots).values()
        return statistics.share([value / 100.0 for value in values]).times(100.0)

    def success(self, intruders: int | None, robots: int) -> Estimate:
        """The mean success rate of a cell, percent; over all numbers of intruders if that is None."""
        return self.percent("success_rate", intruders, robots)

    def health(self, role: str, robots: int, column: str) -> Estimate:
        """The mean of a column of ``robots`` over seeds, all numbers of intruders together."""
        mine = self.robots[(self.robots["role"] == role) & (self.robots["robots"] == robots)]
        per_trial = _means(mine, [*CELL, "seed"], column).reset_index()
        return statistics.mean([*self.by_seed(column, None, robots, per_trial).values()], within=NOT_NEGATIVE)

    def capture_time_by_seed(self) -> dict[int, float]:
        """Seconds from the start, mean over a seed's caught intruders; seeds without any are left out."""
        times_s, times = (_by_seed(self.trials, name) for name in ("capture_times_s", "capture_times"))
        return {seed: times_s[seed] / count for seed, count in times.items() if count}


def pooled_time(trials: pd.DataFrame, times: str) -> Estimate:
    """The mean of ``capture_times`` or ``detection_times`` over intruders, seconds; trials are the unit.

    It is the mean of those that were caught (or detected) alone, so a team that catches the hard ones
    too may look slower; trials without a capture have no part in it.
    """
    return pooled(trials[trials[times] > 0], f"{times}_s", times, NOT_NEGATIVE)


def pooled(trials: pd.DataFrame, part: str, whole: str, within: Range) -> Estimate:
    """The ratio of two columns' sums over trials, with its interval."""
    return statistics.ratio_of_sums(trials[part].tolist(), trials[whole].tolist(), within=within)


def variants_of(results: Results) -> dict[str, Variant]:
    """The finished trials by the values of the grid's other factors (``capture=within``).

    A campaign that varies nothing but the two numbers has one variant, named by the empty text.
    """
    if results not in _VARIANTS:
        _VARIANTS[results] = {} if results.table("trial").empty else _variants(results)
    return _VARIANTS[results]


_VARIANTS: WeakKeyDictionary[Results, dict[str, Variant]] = WeakKeyDictionary()  # made once for each campaign


def _variants(results: Results) -> dict[str, Variant]:
    trials, robots = _trials(results), _robots(results)
    others = [name for name in results.factors if name not in CELL]
    return {
        str(name): Variant(
            {factor: own[factor].tolist()[0] for factor in others},
            own.sort_values(CELL, kind="stable"),
            robots[robots["variant"] == name].sort_values(CELL, kind="stable"),
        )
        for name, own in trials.groupby("variant", sort=False)
    }


def variants_side_by_side(campaigns: Mapping[str, Results]) -> dict[str, Variant]:
    """Those of several campaigns, named by both."""
    return {
        f"{campaign}: {name}" if name else campaign: variant
        for campaign, results in campaigns.items()
        for name, variant in variants_of(results).items()
    }


def counted(number: int, noun: str) -> str:
    """``1 robot``, ``3 robots``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _trials(results: Results) -> pd.DataFrame:
    keys = [*results.factors, "seed"]
    trials, fates = _placed(results, "trial"), results.table("intruders")
    for times, column in (("detection_times", "detected_at_s"), ("capture_times", "caught_at_s")):
        instants = fates.dropna(subset=[column]).groupby(keys, sort=False)[column]
        sums = pd.DataFrame({times: instants.size(), f"{times}_s": instants.agg(exact_sum)})
        trials = trials.join(sums, on=keys).fillna({times: 0, f"{times}_s": 0.0})
    trials = trials.join(results.timing.set_index(keys)[["simulated_s", "wall_s"]], on=keys)
    missed = trials["detected"] - trials["caught"]
    return trials.assign(
        detected_not_caught=100.0 * missed / trials["intruders"],
        simulated_s=trials["simulated_s"].fillna(trials["duration_s"]),
    )


def _robots(results: Results) -> pd.DataFrame:
    """A robot's time in the arena ends when it is taken out, or with the trial."""
    keys = [*results.factors, "seed"]
    robots, fates = _placed(results, "robots"), results.table("intruders")
    ends = fates[keys].assign(
        role=INTRUDER, number=fates.groupby(keys).cumcount(), present_s=fates["left_at_s"]
    )
    robots = robots.assign(number=robots.groupby([*keys, "role"]).cumcount())
    robots = robots.merge(ends, how="left", on=[*keys, "role", "number"])
    robots = robots.join(results.table("trial").set_index(keys)["duration_s"], on=keys)
    present_s = robots["present_s"].fillna(robots["duration_s"])
    defined_s = present_s.where(present_s > 0.0)
    return robots.assign(
        present_s=present_s,
        stuck_percent=100.0 * robots["stuck_s"] / defined_s,
        metres_per_minute=60.0 * robots["distance_m"] / defined_s,
    )


def _placed(results: Results, table: str) -> pd.DataFrame:
    """A table with its variant and the two numbers, whether or not they are factors of the grid."""
    frame = results.table(table)
    numbers = {name: results.whole_numbers(frame, name) for name in CELL}
    return frame.assign(variant=results.other_factors(frame, *CELL), **numbers)


def _by_seed(frame: pd.DataFrame, column: str) -> dict[int, float]:
    """The mean of a column by seed, where it is known."""
    means = _means(frame.dropna(subset=[column]), ["seed"], column)
    return dict(zip(means.index.tolist(), means.tolist(), strict=True))


def _means(frame: pd.DataFrame, keys: Sequence[str], column: str) -> pd.Series:
    """The mean of each group of rows that agree in the keys, in the order of their first rows.

    Of exact sums: pandas' own change with the order of the rows and with its version.
    """
    return frame.groupby([*keys], sort=False)[column].agg(lambda values: exact_mean(values.tolist()))
