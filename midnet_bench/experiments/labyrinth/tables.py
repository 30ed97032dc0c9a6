"""The labyrinth's result: success rates by team size (Eq. 11), what lies behind them, the robots' health."""

import itertools
import math
from collections.abc import Mapping

import pandas as pd

from midnet_bench.analysis.claims import Finding, comparison, finding
from midnet_bench.analysis.compare import MEASURE, SCOPE
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.power import ALPHA, POWER, pilot_note, power_cells
from midnet_bench.analysis.statistics import SHARE_METHOD, exact_mean, exact_sum, mean, ratio_of_sums
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.errors import InputError
from midnet_bench.experiments.experiment import Headline
from midnet_bench.experiments.guarded.metric_tables import metric_measures, metric_tables
from midnet_bench.experiments.labyrinth.trials import (
    GUARD,
    INTRUDER,
    Variant,
    variants_of,
    variants_side_by_side,
)

PAPER_REAL_TIME_FACTOR = 0.18
"""17 simulated hours in 92 hours, section V.B"""

PAPER_DURATION_S = 17 * 3600 / 500
"""Of a trial at most: "approximately 17 hours" of simulated time for 500, section V.B. Those hours also hold
what lies between two trials, such as the spawning of up to ten robots."""

COUNTED = ("goals_reached", "goals_given_up", "collisions", "recoveries", "walls_crossed")

Variants = Mapping[str, Variant]


def tables(results: Results) -> list[Table]:
    """The tables of a labyrinth campaign."""
    variants = variants_of(results)
    if not variants:
        return []
    return [
        success_table(variants),
        cells_table(variants),
        health_table(variants),
        speed_table(variants),
        *metric_tables(results),
    ]


def headline(results: Results, reference: Results | None = None) -> Headline:
    """The table of success rates, the rise with the team in words, and what to type next.

    Args:
        results: of a labyrinth campaign with a finished trial.
        reference: not used; the paper prints no numbers of this test.
    """
    variants = variants_of(results)
    sentences = []
    for name, one in variants.items():
        rates = {robots: one.success(None, robots) for robots in one.team_sizes}
        known = [(robots, rate) for robots, rate in rates.items() if not math.isnan(rate.value)]
        parts = [
            f"{robots} robot{'' if robots == 1 else 's'} {rate.value:.0f} %"
            for robots, rate in (known[:1] + known[-1:] if len(known) > 1 else known)
        ]
        if parts:
            sentences.append(f"{name + ': c' if name else 'C'}aught of all intruders: {', '.join(parts)}.")
    trials = results.definition.trials
    following = (
        f"{trials} trial{'' if trials == 1 else 's'} per cell say little: --seeds 20 runs the paper's number."
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
    rows: list[Mapping[str, Cell]] = []
    for variant, one in variants.items():
        for intruders in [*one.intruder_counts, None]:
            rates = {
                f"{robots} robot{'s' if robots > 1 else ''}": one.success(intruders, robots)
                for robots in one.team_sizes
            }
            key: Mapping[str, Cell] = {"intruders": "all" if intruders is None else intruders}
            least = min(rate.n for rate in rates.values())
            rows.append({**_named(variants, variant), **key, **rates, "n": least})
    title = f"Success rate, percent ({SHARE_METHOD}, over trials)"
    robots = {column: 1 for row in rows for column in row if column.endswith(("robot", "robots"))}
    return Table(name, title, rows, robots, beside=("n",))


def cells_table(variants: Variants) -> Table:
    """A row per cell: rates in percent and times in seconds, each with its 95 % interval."""
    rows: list[Mapping[str, Cell]] = []
    for variant, one in variants.items():
        for intruders, robots, cell in one.cells():
            row: dict[str, Cell] = {
                **_named(variants, variant),
                "intruders": intruders,
                "robots": robots,
                "trials": len(cell),
                "success_rate": one.success(intruders, robots),
                "detected_not_caught": one.not_caught(intruders, robots),
                "time_to_detect_s": one.pooled_time(intruders, robots, "detection_times"),
                "time_to_capture_s": one.pooled_time(intruders, robots, "capture_times"),
                "duration_s": mean(cell["simulated_s"].tolist(), within=(0.0, math.inf)),
            }
            ghosts = (100.0 * cell["ghost_targets"]).tolist()
            row["ghost_targets"] = ratio_of_sums(ghosts, cell["targets"].tolist(), within=(0.0, 100.0))
            rows.append(row)
    digits = {"success_rate": 1, "detected_not_caught": 1, "duration_s": 1, "ghost_targets": 1}
    return Table(
        "success_rate_cells",
        f"Labyrinth cells ({SHARE_METHOD}; of times: Student's t, corrected for skewness)",
        rows,
        digits,
        beside=("ghost_targets", "detected_not_caught", "time_to_detect_s"),
    )


def health_table(variants: Variants) -> Table:
    """How guards and intruders drove, by team size: per robot and trial, over all numbers of intruders."""
    rows: list[Mapping[str, Cell]] = []
    for variant, one in variants.items():
        for size in one.team_sizes:
            for role in (GUARD, INTRUDER):
                robots = one.robots[(one.robots["robots"] == size) & (one.robots["role"] == role)]
                key = {**_named(variants, variant), "robots": size, "role": role}
                if len(robots):
                    rows.append({**key, **_health(robots)})
    digits = {"goals_reached": 2, "goals_given_up": 2, "recoveries": 2, "metres_per_minute": 1}
    digits |= {"stuck_percent": 1, "most_stuck_percent": 1}
    beside = ("recoveries", "walls_crossed", "robot_trials", "goals_given_up", "most_stuck_percent")
    return Table("labyrinth_health", "Health of the robots", rows, digits, beside=beside)


def _health(robots: pd.DataFrame) -> dict[str, Cell]:
    present_s = exact_sum(robots["present_s"])
    row: dict[str, Cell] = {
        "robot_trials": len(robots),
        "metres_per_minute": 60.0 * _ratio(exact_sum(robots["distance_m"]), present_s),
        "stuck_percent": 100.0 * _ratio(exact_sum(robots["stuck_s"]), present_s),
        "most_stuck_percent": max(robots["stuck_percent"]),
    }
    return row | {name: exact_mean(robots[name]) for name in COUNTED}


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole else math.nan


def speed_table(variants: Variants) -> Table:
    """What a simulated second costs in seconds of one core's time, by the number of robots in the arena."""
    everything = pd.concat([one.trials for one in variants.values()])
    groups = everything.groupby(everything["intruders"] + everything["robots"])
    every: list[tuple[int | str, pd.DataFrame]] = [(int(str(count)), trials) for count, trials in groups]
    rows: list[Mapping[str, Cell]] = []
    for count, trials in [*every, ("all", everything)]:
        simulated_s, wall_s = exact_sum(trials["simulated_s"]), exact_sum(trials["wall_s"])
        rows.append(
            {
                "robots_in_arena": count,
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

    The duration is judged where all 25 cells are there. The dips are those of 1 and 5 intruders, from 4 to 5.
    "Generally increase" is read as a rise from the smallest team to four robots for every number of
    intruders, and from each size to the next, up to four, over all of them. Differences are seed by seed.
    Nothing is judged of a campaign in another arena than Map 2.
    """
    if results.definition.parameters.get("arena", "map2") != "map2":
        return []
    return [
        one._replace(claim=f"{name}: {one.claim}" if name else one.claim)
        for name, variant in variants_of(results).items()
        for one in _claims(variant)
    ]


def _claims(one: Variant) -> list[Finding]:
    up_to_four = [size for size in one.team_sizes if size <= 4]
    found = []
    if len(up_to_four) > 1:
        for intruders in one.intruder_counts:
            found.append(_change(one, intruders, up_to_four[0], up_to_four[-1], rises=True))
        for smaller, larger in itertools.pairwise(up_to_four):
            found.append(_change(one, None, smaller, larger, rises=True))
    if {4, 5} <= set(one.team_sizes):
        counts = [intruders for intruders in one.intruder_counts if intruders in (1, 5)]
        found += [_change(one, intruders, 4, 5, rises=False) for intruders in counts]
    if one.team_sizes == one.intruder_counts == [1, 2, 3, 4, 5]:
        claim = f"a trial lasts at most {PAPER_DURATION_S:.0f} s on average"
        found.append(finding(claim, one.duration, -math.inf, PAPER_DURATION_S))
    return found


def _change(one: Variant, intruders: int | None, smaller: int, larger: int, *, rises: bool) -> Finding:
    first, second = one.rates_by_seed(intruders, smaller), one.rates_by_seed(intruders, larger)
    against = "all intruders" if intruders is None else f"{intruders} intruder{'s' if intruders > 1 else ''}"
    verb = "rises" if rises else "falls"
    claim = f"{against}: the success rate (percent) {verb} from {smaller} to {larger} robots"
    return comparison(claim, first, second, rises, within=(0.0, 100.0))


def measures(results: Results) -> pd.DataFrame:
    """Percent caught by team size, over all numbers of intruders; both and durations over all cells.

    With them stand further metrics by cell. A frame of scores.
    """
    rows: list[dict[str, object]] = []

    def add(one: Variant, over: Mapping[str, object], measure: str, by_seed: Mapping[int, float]) -> None:
        for seed, value in by_seed.items():
            rows.append({**over, **one.factors, "seed": seed, MEASURE: measure, "value": value})

    for one in variants_of(results).values():
        for robots in one.team_sizes:
            add(one, {"robots": robots}, "caught_percent", one.rates_by_seed(None, robots))
        over = {SCOPE: "all cells"}
        add(one, over, "caught_percent", one.all_cells_by_seed("success_rate"))
        add(one, over, "duration_s", one.all_cells_by_seed("duration_s"))
        add(one, over, "time_to_capture_s", one.capture_time_by_seed())
    return pd.concat([pd.DataFrame(rows, dtype=object), metric_measures(results)])


def power_table(results: Results, difference: float, robots: tuple[int, int], power: float = POWER) -> Table:
    """For each number of intruders, and over all: the trials per team size that a change of success needs.

    Args:
        results: of a labyrinth campaign.
        difference: of the success rate, percentage points.
        robots: the two team sizes that are compared.
        power: the probability of finding the difference if it is there.

    Raises:
        InputError: a team size without finished trials.
    """
    variants = variants_of(results)
    rows: list[Mapping[str, Cell]] = []
    pilots = []
    for name, one in variants.items():
        for size in robots:
            if size not in one.team_sizes:
                where = f"{results.directory}: no finished trials with {size} robots"
                raise InputError(f"{where} ({name})" if name else where)
        for intruders in [*one.intruder_counts, None]:
            first, second = (one.rates_by_seed(intruders, size) for size in robots)
            key: Mapping[str, Cell] = {"intruders": "all" if intruders is None else intruders}
            cells = power_cells(first, second, difference, power)
            pilots.append((first, second))
            rows.append({**_named(variants, name), **key, **cells})
    title = (
        f"Trials per team size to show {difference:g} points between {robots[0]} and {robots[1]} robots"
        f" (two-sided {ALPHA:.0%}, power {power:.0%})"
    )
    digits = {"sd": 1, "sd_paired": 1, "trials_needed": 0, "pairs_needed": 0, "mde": 1, "mde_paired": 1}
    notes = pilot_note(pilots, difference, power)
    return Table("sample_size", title, rows, digits, notes=notes, beside=("sd", "sd_paired"))


def _named(variants: Variants, name: str) -> dict[str, Cell]:
    """A column for the variant where there are several."""
    return {"variant": name} if len(variants) > 1 else {}
