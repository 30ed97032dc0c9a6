"""What teams of explorers bring home: their maps' worth, how long it takes, and which map is to be kept."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

from midnet_bench.analysis import statistics
from midnet_bench.analysis.statistics import Estimate
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.store import Store
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.io.files import write_atomically
from midnet_bench.rng import stream

MEASURES: Mapping[str, bool] = {
    "coverage": True,
    "occupied_precision": True,
    "occupied_recall": True,
    "wall_error_m": False,
    "time_s": False,
    "distance_m": False,
}
"""column of ``maps`` -> whether more is better"""
ENOUGH_COVERAGE = 0.98
"""less of the free space within reach is not a map of the arena"""
BEST = 3
"""maps of each arena that the choice shows"""
SHOWN = ("occupied_precision", "occupied_recall", "wall_error_m", "coverage")
"""what it shows of them"""
COUNTED = ("collisions", "walls_crossed", "recoveries", "goals_given_up")

Maps = Mapping[str, Mapping[int, Sequence[Row]]]
"""arena -> team size -> its trials' ``maps`` rows with their seeds, ascending"""


def write_mapping_report(store: Store, directory: Path) -> list[Table]:
    """Write the tables and the figure of a mapping campaign into ``directory``; the tables worth printing."""
    maps, robots = rows_of(store, "maps"), rows_of(store, "robots")
    if not maps:
        return []
    tables = {
        "mapping": teams_table(maps),
        "mapping_walls": walls_table(maps),
        "mapping_speedup": speedup_table(maps),
        "mapping_choice": choice_table(maps),
        "mapping_measures": measures_table(maps),
        "mapping_health": health_table(robots),
    }
    for stem, table in tables.items():
        table.write(directory / stem)
    from midnet_bench.experiments.labyrinth.figures import png_and_svg
    from midnet_bench.experiments.mapping.figures import mapping_figure

    for ending, content in png_and_svg(mapping_figure(maps)).items():
        write_atomically(directory / f"mapping{ending}", content)
    return [tables[name] for name in ("mapping", "mapping_walls", "mapping_speedup", "mapping_choice")]


def rows_of(store: Store, table: str) -> Maps:
    """The rows of the finished trials by arena (with the grid's other factors, if any) and team size."""
    arenas: dict[str, dict[int, list[Row]]] = {}
    for trial in store.trials():
        if trial.status == "finished":
            cell = store.definition.cell_of(trial.parameters)
            others = [f"{name}={value}" for name, value in cell.items() if name not in ("arena", "robots")]
            arena = ", ".join([_name(str(trial.parameters["arena"])), *others])
            team = arenas.setdefault(arena, {}).setdefault(int(_number(trial.parameters["robots"])), [])
            team += [{"seed": trial.seed, **row} for row in trial.tables[table]]
    return {arena: dict(sorted(teams.items())) for arena, teams in arenas.items()}


def teams_table(maps: Maps) -> Table:
    """A row per arena and team: how much it explored and what that took, means with 95 % intervals."""
    rows: list[Row] = []
    for arena, teams in maps.items():
        for robots, trials in teams.items():
            covered = [_number(one["coverage"]) for one in trials]
            finished = sum(bool(one["finished"]) for one in trials)
            row: Row = {"arena": arena, "robots": robots, "finished": f"{finished} of {len(trials)}"}
            enough = sum(share >= ENOUGH_COVERAGE for share in covered)
            row[f"covered {ENOUGH_COVERAGE:.0%}"] = f"{enough} of {len(trials)}"
            row["covered_percent"] = _interval(mean_of(trials, "coverage"), 2, 100.0)
            row["time_s"] = _interval(mean_of(trials, "time_s"), 1)
            row["distance_m"] = _interval(mean_of(trials, "distance_m"), 1)
            rows.append(row)
    return Table("What explorers cover and what it takes (95 % intervals over seeds)", rows)


def walls_table(maps: Maps) -> Table:
    """A row per arena and team: how right the maps are, means with 95 % intervals."""
    rows: list[Row] = []
    for arena, teams in maps.items():
        for robots, trials in teams.items():
            row: Row = {"arena": arena, "robots": robots}
            row["occupied_precision"] = _interval(mean_of(trials, "occupied_precision"), 3)
            row["occupied_recall"] = _interval(mean_of(trials, "occupied_recall"), 3)
            row["wall_error_cm"] = _interval(mean_of(trials, "wall_error_m"), 2, 100.0)
            rows.append(row)
    return Table("Occupied cells of their maps, within one cell (95 % intervals over seeds)", rows)


def measures_table(maps: Maps) -> Table:
    """A row per arena, team and measure: mean with its interval, median, and the worst seed."""
    rows: list[Row] = []
    for arena, teams in maps.items():
        for robots, trials in teams.items():
            for measure, more_is_better in MEASURES.items():
                values = sorted(
                    (value, int(_number(one["seed"])))
                    for one in trials
                    if not math.isnan(value := _number(one[measure]))
                )
                worst, seed = (values[0] if more_is_better else values[-1]) if values else (math.nan, None)
                mean = mean_of(trials, measure)
                rows.append(
                    {
                        "arena": arena,
                        "robots": robots,
                        "measure": measure,
                        "mean": mean.value,
                        "low": mean.low,
                        "high": mean.high,
                        "median": median([value for value, _ in values]) if values else math.nan,
                        "worst": worst,
                        "worst_seed": seed,
                        "n": mean.n,
                    }
                )
    digits = dict.fromkeys(("mean", "low", "high", "median", "worst"), 4)
    return Table("Each measure of the maps", rows, digits)


def speedup_table(maps: Maps) -> Table:
    """A row per arena and larger team: its time over that of the smallest, summed over the seeds of both.

    The interval is the bootstrap's over seeds, both times of a seed drawn together.
    """
    rows: list[Row] = []
    for arena, teams in maps.items():
        smallest, *larger = teams
        for robots in larger:
            pairs = _pairs(teams[smallest], teams[robots], "time_s")
            ratio = statistics.ratio_of_sums(
                [time_s for _, time_s in pairs],
                [alone_s for alone_s, _ in pairs],
                stream(0, "bootstrap", "speedup", arena, robots),
            )
            rows.append(
                {
                    "arena": arena,
                    "robots": robots,
                    "instead_of": smallest,
                    "time_ratio": ratio.value,
                    "low": ratio.low,
                    "high": ratio.high,
                    "faster": f"{sum(time_s < alone_s for alone_s, time_s in pairs)} of {len(pairs)}",
                }
            )
    return Table("Time of a team over that of the smallest (95 % interval over seeds)", rows)


def choice_table(maps: Maps) -> Table:
    """The best maps of each arena, the one to keep as its prior map first.

    Of the finished explorations that cover 98 % of the free space within reach, the one whose occupied cells
    have the highest F1 within one cell, then the one that covers most, both to four digits; then the smaller
    wall error, the smaller team, the lower seed.
    """
    rows: list[Row] = []
    for arena, teams in maps.items():
        candidates: list[Row] = [
            {
                "robots": robots,
                "seed": one["seed"],
                "occupied_f1": _f1(one),
                **{key: one[key] for key in SHOWN},
            }
            for robots, trials in teams.items()
            for one in trials
            if one["finished"] and _number(one["coverage"]) >= ENOUGH_COVERAGE
        ]
        best = sorted(candidates, key=_rank)[:BEST]
        rows += [
            {"arena": arena, "choice": "chosen" if place == 0 else f"{place + 1}.", **one}
            for place, one in enumerate(best)
        ]
    title = f"Best maps: finished, {ENOUGH_COVERAGE:.0%} covered; highest occupied F1, then most covered"
    return Table(title, rows, dict.fromkeys(("occupied_f1", *SHOWN), 4))


def health_table(robots: Maps) -> Table:
    """A row per arena and team: how its robots drove, and how wrong they were about where they ended."""
    rows: list[Row] = []
    for arena, teams in robots.items():
        for size, team in teams.items():
            row: Row = {"arena": arena, "robots": size, "robot_trials": len(team)}
            for name in ("distance_m", "stuck_s", "pose_error_m"):
                row[name] = sum(_number(one[name]) for one in team) / len(team)
            row["most_pose_error_m"] = max(_number(one["pose_error_m"]) for one in team)
            row |= {name: sum(int(_number(one[name])) for one in team) for name in COUNTED}
            rows.append(row)
    return Table("How the explorers fared", rows, {"distance_m": 1, "stuck_s": 1})


def mean_of(trials: Sequence[Row], measure: str) -> Estimate:
    """The mean of one measure over trials, with its 95 % bootstrap interval."""
    return statistics.mean([_number(one[measure]) for one in trials], stream(0, "bootstrap", measure))


def _f1(trial: Row) -> float:
    precision, recall = _number(trial["occupied_precision"]), _number(trial["occupied_recall"])
    return 2.0 * precision * recall / (precision + recall) if precision + recall > 0.0 else math.nan


def _rank(candidate: Row) -> tuple[float, ...]:
    f1 = _number(candidate["occupied_f1"])
    return (
        math.inf if math.isnan(f1) else -round(f1, 4),
        -round(_number(candidate["coverage"]), 4),
        _number(candidate["wall_error_m"]),
        _number(candidate["robots"]),
        _number(candidate["seed"]),
    )


def _pairs(first: Sequence[Row], second: Sequence[Row], measure: str) -> list[tuple[float, float]]:
    """A measure of both at each seed that both have."""
    by_seed = {one["seed"]: _number(one[measure]) for one in second}
    return [(_number(one[measure]), by_seed[one["seed"]]) for one in first if one["seed"] in by_seed]


def _interval(estimate: Estimate, digits: int, factor: float = 1.0) -> str:
    """``value (low-high)``, all times ``factor``."""
    if estimate.n == 0:
        return "n/a"
    value, low, high = (f"{factor * number:.{digits}f}" for number in estimate[:3])
    return value if estimate.n == 1 else f"{value} ({low}-{high})"


def _name(arena: str) -> str:
    """A packaged arena's name, or the one that a file gives it."""
    return str(json.loads(arena)["name"]) if arena.startswith("{") else arena


def _number(value: Scalar) -> float:
    return math.nan if value is None else float(value)
