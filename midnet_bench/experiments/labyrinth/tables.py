"""The labyrinth's trials by cell, success rates by team size (Eq. 11), and what lies behind them."""

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from weakref import WeakKeyDictionary

import pandas as pd

from midnet_bench.analysis.claims import Finding, comparison, finding
from midnet_bench.analysis.compare import MEASURE, SCOPE
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.sample_size import ALPHA, POWER, pilot_note, power_cells
from midnet_bench.analysis.statistics import (
    NOT_NEGATIVE,
    SHARE_METHOD,
    Estimate,
    Range,
    exact_mean,
    exact_sum,
    mean,
    ratio_of_sums,
    share,
)
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.errors import InputError
from midnet_bench.experiments.guarded.tables import metric_measures, metric_tables
from midnet_bench.experiments.registry import Headline

GUARD, INTRUDER = "guard", "intruder"
CELL = ["intruders", "robots"]
PAPER_REAL_TIME_FACTOR = 0.18  # 17 simulated hours in 92 hours, section V.B
PAPER_DURATION_S = 17 * 3600 / 500
"""Of a trial at most: "approximately 17 hours" of simulated time for 500, section V.B. Those hours also hold
what lies between two trials, such as the spawning of up to ten robots."""
COUNTED = ("goals_reached", "goals_given_up", "collisions", "recoveries", "walls_crossed")

TableRow = Mapping[str, Cell]


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
        return share([value / 100.0 for value in values]).times(100.0)

    def success(self, intruders: int | None, robots: int) -> Estimate:
        """The mean success rate of a cell, percent; over all numbers of intruders if that is None."""
        return self.percent("success_rate", intruders, robots)

    def health(self, role: str, robots: int, column: str) -> Estimate:
        """The mean of a column of ``robots`` over seeds, all numbers of intruders together."""
        mine = self.robots[(self.robots["role"] == role) & (self.robots["robots"] == robots)]
        per_trial = _means(mine, [*CELL, "seed"], column).reset_index()
        return mean([*self.by_seed(column, None, robots, per_trial).values()], within=NOT_NEGATIVE)

    def capture_time_by_seed(self) -> dict[int, float]:
        """Seconds from the start, mean over a seed's caught intruders; seeds without any are left out."""
        times_s, times = (_by_seed(self.trials, name) for name in ("capture_times_s", "capture_times"))
        return {seed: times_s[seed] / count for seed, count in times.items() if count}


Variants = Mapping[str, Variant]


def tables(results: Results) -> list[Table]:
    """The tables of a labyrinth campaign."""
    variants = variants_of(results)
    made = (success_table, cells_table, health_table, speed_table) if variants else ()
    return [*(make(variants) for make in made), *(metric_tables(results) if variants else ())]


def headline(results: Results, reference: Results | None = None) -> Headline:
    """The table of success rates, the rise with the team in words, and what to type next.

    ``reference`` is not used: the paper prints no numbers of this test.
    """
    variants = variants_of(results)
    sentences = []
    for name, one in variants.items():
        rates = {robots: one.success(None, robots).value for robots in one.team_sizes}
        known = [f"{counted(q, 'robot')} {rate:.0f} %" for q, rate in rates.items() if not math.isnan(rate)]
        if known:
            ends = known if len(known) == 1 else [known[0], known[-1]]
            sentences.append(f"{name + ': c' if name else 'C'}aught of all intruders: {', '.join(ends)}.")
    trials = results.definition.trials
    following = (
        f"{counted(trials, 'trial')} per cell say little: --seeds 20 runs the paper's number."
        if trials < 20
        else f"Next: 'midnet-bench verify {results.directory}' checks each claim of the paper."
    )
    notes = ["Times, health of the robots and speed: --wide."]
    return Headline([success_table(variants), *metric_tables(results)], sentences, notes, following)


def success_table(variants: Variants, name: str = "success_rate") -> Table:
    """The paper's figure in numbers: percent caught with its 95 % interval; rows by number of intruders.

    The last row is over all numbers of intruders; its unit is the seed, because trials of one seed meet
    the same intruders. ``n`` is the fewest trials (or seeds) behind a number of the row.
    """

    def rows_of(one: Variant) -> Iterator[TableRow]:
        for intruders, key in _numbers_of_intruders(one):
            rates = {counted(robots, "robot"): one.success(intruders, robots) for robots in one.team_sizes}
            yield {**key, **rates, "n": min(rate.n for rate in rates.values())}

    rows = _rows(variants, rows_of)
    title = f"Success rate, percent ({SHARE_METHOD}, over trials)"
    digits = {column: 1 for row in rows for column in row if column.endswith(("robot", "robots"))}
    return Table(name, title, rows, digits, beside=("n",))


def cells_table(variants: Variants) -> Table:
    """A row per cell: rates in percent and times in seconds, each with its 95 % interval."""

    def rows_of(one: Variant) -> Iterator[TableRow]:
        for intruders, robots, cell in one.cells():
            false = cell.assign(target_percents=100.0 * cell["ghost_targets"])
            time: TableRow = {}
            if "false_target_s" in cell and cell["false_target_s"].notna().all():  # older results lack it
                percents, guard_s = 100.0 * cell["false_target_s"], robots * cell["duration_s"]
                false = false.assign(time_percents=percents, guard_s=guard_s)
                time = {"false_target_time": pooled(false, "time_percents", "guard_s", (0.0, 100.0))}
            yield {
                "intruders": intruders,
                "robots": robots,
                "trials": len(cell),
                "success_rate": one.success(intruders, robots),
                "detected_not_caught": one.percent("detected_not_caught", intruders, robots),
                "time_to_detect_s": pooled_time(cell, "detection_times"),
                "time_to_capture_s": pooled_time(cell, "capture_times"),
                "duration_s": mean(cell["simulated_s"].tolist(), within=NOT_NEGATIVE),
                "ghost_targets": pooled(false, "target_percents", "targets", (0.0, 100.0)),
                **time,
            }

    title = f"Labyrinth cells ({SHARE_METHOD}; of times: Student's t, corrected for skewness)"
    percents = ("success_rate", "detected_not_caught", "ghost_targets", "false_target_time")
    digits = dict.fromkeys((*percents, "duration_s"), 1)
    beside = ("false_target_time", "ghost_targets", "detected_not_caught", "time_to_detect_s")
    return Table("success_rate_cells", title, _rows(variants, rows_of), digits, beside=beside)


def health_table(variants: Variants) -> Table:
    """How guards and intruders drove, by team size: per robot and trial, over all numbers of intruders."""

    def rows_of(one: Variant) -> Iterator[TableRow]:
        for size, role in itertools.product(one.team_sizes, (GUARD, INTRUDER)):
            robots = one.robots[(one.robots["robots"] == size) & (one.robots["role"] == role)]
            if len(robots):
                present_s = exact_sum(robots["present_s"])
                yield {
                    "robots": size,
                    "role": role,
                    "robot_trials": len(robots),
                    "metres_per_minute": 60.0 * _ratio(exact_sum(robots["distance_m"]), present_s),
                    "stuck_percent": 100.0 * _ratio(exact_sum(robots["stuck_s"]), present_s),
                    "most_stuck_percent": max(robots["stuck_percent"]),
                    **{name: exact_mean(robots[name]) for name in COUNTED},
                }

    digits = dict.fromkeys(("goals_reached", "goals_given_up", "recoveries"), 2)
    digits |= dict.fromkeys(("metres_per_minute", "stuck_percent", "most_stuck_percent"), 1)
    beside = ("recoveries", "walls_crossed", "robot_trials", "goals_given_up", "most_stuck_percent")
    rows = _rows(variants, rows_of)
    return Table("labyrinth_health", "Health of the robots", rows, digits, beside=beside)


def speed_table(variants: Variants) -> Table:
    """What a simulated second costs in seconds of one core's time, by the number of robots in the arena."""
    everything = pd.concat([one.trials for one in variants.values()])
    groups = everything.groupby(everything["intruders"] + everything["robots"])
    rows: list[TableRow] = []
    for count, trials in [*((str(count), trials) for count, trials in groups), ("all", everything)]:
        simulated_s, wall_s = exact_sum(trials["simulated_s"]), exact_sum(trials["wall_s"])
        rows.append(
            {
                "robots_in_arena": int(count) if count.isdigit() else count,
                "trials": len(trials),
                "simulated_s": simulated_s,
                "wall_s": wall_s,
                "wall_per_simulated": _ratio(wall_s, simulated_s),
                "real_time_factor": _ratio(simulated_s, wall_s),
                "paper": PAPER_REAL_TIME_FACTOR,
            }
        )
    digits = {"simulated_s": 0, "wall_s": 0, "real_time_factor": 1, "paper": 2}
    return Table("labyrinth_speed", "Speed of one worker", rows, digits, beside=("wall_s", "simulated_s"))


def comparison_tables(campaigns: Mapping[str, Results]) -> list[Table]:
    """Several campaigns' success rates in one table, a variant for each."""
    return [success_table(variants_side_by_side(campaigns), "success_comparison")]


def claims(results: Results) -> list[Finding]:
    """The shape of the paper's figure, a rise with the team and two dips; and how long a trial takes.

    "Generally increase" and "climb upwards from 1 to 4" are read as a rise over all numbers of intruders,
    from the smallest team to four robots and by each robot on the way. The dips are those of 1 and 5
    intruders, from 4 to 5. The duration is judged where all 25 cells are there. Differences are seed by seed.
    Nothing is judged of a campaign in another arena than Map 2.
    """
    if results.definition.parameters.get("arena", "map2") != "map2":
        return []
    return [
        each._replace(claim=f"{name}: {each.claim}" if name else each.claim)
        for name, variant in variants_of(results).items()
        for each in _claims(variant)
    ]


def _claims(one: Variant) -> Iterator[Finding]:
    def change(
        intruders: int | None, smaller: int, larger: int, rises: bool = True, note: str = ""
    ) -> Finding:
        first, second = (one.by_seed("success_rate", intruders, size) for size in (smaller, larger))
        against = "all intruders" if intruders is None else counted(intruders, "intruder")
        verb = "rises" if rises else "falls"
        claim = f"{against}: the success rate (percent) {verb} from {counted(smaller, 'robot')} to {larger}"
        return comparison(claim, first, second, rises, (0.0, 100.0), note)

    up_to_four = [size for size in one.team_sizes if size <= 4]
    climbs = [*itertools.pairwise(up_to_four)]
    if len(climbs) > 1:
        climbs.insert(0, (up_to_four[0], up_to_four[-1]))
    yield from (change(None, *sizes, note=_falling(one, *sizes)) for sizes in climbs)
    if {4, 5} <= set(one.team_sizes):
        yield from (change(k, 4, 5, rises=False) for k in one.intruder_counts if k in (1, 5))
    if one.team_sizes == one.intruder_counts == [1, 2, 3, 4, 5]:
        claim = f"a trial lasts at most {PAPER_DURATION_S:.0f} s on average"
        durations_s = [*one.by_seed("duration_s").values()]
        yield finding(claim, partial(mean, durations_s, within=NOT_NEGATIVE), -math.inf, PAPER_DURATION_S)


def _falling(one: Variant, smaller: int, larger: int) -> str:
    """In how many of the curves, one for each number of intruders, the mean falls between two team sizes."""
    curves = one.intruder_counts
    falling = [k for k in curves if one.success(k, larger).value < one.success(k, smaller).value]
    if len(curves) < 2:
        return ""
    which = f" ({', '.join(map(str, falling))} intruders)" if 0 < len(falling) < len(curves) else ""
    verb = "falls" if len(falling) == 1 else "fall"
    return f"{len(falling)} of {len(curves)} curves {verb} there{which}."


def measures(results: Results) -> pd.DataFrame:
    """Percent caught by team size, over all numbers of intruders; both and durations over all cells.

    With them stand further metrics by cell. A frame of scores.
    """
    rows: list[dict[str, object]] = []

    def add(over: Mapping[str, object], measure: str, by_seed: Mapping[int, float]) -> None:
        rows.extend({**over, "seed": seed, MEASURE: measure, "value": by_seed[seed]} for seed in by_seed)

    for one in variants_of(results).values():
        for robots in one.team_sizes:
            over = {"robots": robots, **one.factors}
            add(over, "caught_percent", one.by_seed("success_rate", None, robots))
        over = {SCOPE: "all cells", **one.factors}
        add(over, "caught_percent", one.by_seed("success_rate"))
        add(over, "duration_s", one.by_seed("duration_s"))
        add(over, "time_to_capture_s", one.capture_time_by_seed())
    return pd.concat([pd.DataFrame(rows, dtype=object), metric_measures(results)])


def power_table(results: Results, difference: float, robots: tuple[int, int], power: float = POWER) -> Table:
    """For each number of intruders, and over all: the trials per team size that a change of success needs.

    ``difference`` is in percentage points, between two team sizes; ``power`` the probability of finding it if
    it is there. Raises InputError on a team size without finished trials.
    """
    variants = variants_of(results)
    for (name, one), size in itertools.product(variants.items(), robots):
        if size not in one.team_sizes:
            where = f"{results.directory}: no finished trials with {size} robots"
            raise InputError(f"{where} ({name})" if name else where)
    pilots = []

    def rows_of(one: Variant) -> Iterator[TableRow]:
        for intruders, key in _numbers_of_intruders(one):
            first, second = (one.by_seed("success_rate", intruders, size) for size in robots)
            pilots.append((first, second))
            yield {**key, **power_cells(first, second, difference, power)}

    rows = _rows(variants, rows_of)
    title = (
        f"Trials per team size to show {difference:g} points between {robots[0]} and {robots[1]} robots"
        f" (two-sided {ALPHA:.0%}, power {power:.0%})"
    )
    digits = {"sd": 1, "sd_paired": 1, "trials_needed": 0, "pairs_needed": 0, "mde": 1, "mde_paired": 1}
    notes = pilot_note(pilots, difference, power)
    return Table("sample_size", title, rows, digits, notes=notes, beside=("sd", "sd_paired"))


def _rows(variants: Variants, rows_of: Callable[[Variant], Iterator[TableRow]]) -> list[TableRow]:
    """The rows of all variants, with a column for the variant where there are several."""
    return [
        {**({"variant": name} if len(variants) > 1 else {}), **row}
        for name, one in variants.items()
        for row in rows_of(one)
    ]


def _numbers_of_intruders(one: Variant) -> list[tuple[int | None, TableRow]]:
    """Each number, then None for all of them; and the column that says so."""
    return [(count, {"intruders": count}) for count in one.intruder_counts] + [(None, {"intruders": "all"})]


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else math.nan


def pooled_time(trials: pd.DataFrame, times: str) -> Estimate:
    """The mean of ``capture_times`` or ``detection_times`` over intruders, seconds; trials are the unit.

    It is the mean of those that were caught (or detected) alone, so a team that catches the hard ones
    too may look slower; trials without a capture have no part in it.
    """
    return pooled(trials[trials[times] > 0], f"{times}_s", times, NOT_NEGATIVE)


def pooled(trials: pd.DataFrame, part: str, whole: str, within: Range) -> Estimate:
    """The ratio of two columns' sums over trials, with its interval."""
    return ratio_of_sums(trials[part].tolist(), trials[whole].tolist(), within=within)


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
