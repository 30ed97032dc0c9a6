"""The explorers' results: quality of their maps, how long they take, and the choice of a prior map."""

import json
import math
from collections.abc import Iterator, Mapping
from statistics import median

import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.frames import Results, records
from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate, exact_mean
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.tables import shown
from midnet_bench.errors import InputError

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
SHOWN = ("gaps_m", "occupied_precision", "occupied_recall", "wall_error_m", "coverage")
"""what it shows of them"""
COUNTED = ("collisions", "walls_crossed", "recoveries", "goals_given_up")

Maps = Mapping[str, Mapping[int, pd.DataFrame]]
"""arena -> team size -> the rows of its finished trials, seeds ascending"""


def tables(results: Results) -> list[Table]:
    """The tables of a mapping campaign."""
    maps = rows_of(results, "maps")
    if not maps:
        return []
    return [
        teams_table(maps),
        walls_table(maps),
        speedup_table(maps),
        choice_table(maps, rows_of(results, "gaps") if "gaps" in results.tables else {}),
        measures_table(maps),
        health_table(rows_of(results, "robots")),
    ]


def rows_of(results: Results, table: str) -> Maps:
    """The rows of a table by arena (with the grid's other factors, if any) and team size, ascending."""
    frame = results.table(table)
    if frame.empty:
        return {}
    sizes = results.whole_numbers(frame, "robots").astype(int)
    arenas = [
        f"{_name(str(arena))}{', ' if others else ''}{others}"
        for arena, others in zip(
            results.column(frame, "arena"), results.other_factors(frame, "arena", "robots"), strict=True
        )
    ]
    return {
        str(arena): {int(str(robots)): team for robots, team in rows.groupby(sizes)}
        for arena, rows in frame.groupby(pd.Series(arenas, frame.index), sort=False)
    }


def _teams(maps: Maps) -> Iterator[tuple[dict[str, Cell], pd.DataFrame]]:
    """The columns that name each arena and team, and its rows."""
    for arena, teams in maps.items():
        for robots, rows in teams.items():
            yield {"arena": arena, "robots": robots}, rows


def teams_table(maps: Maps) -> Table:
    """A row per arena and team: how much it explored and what that took, means with 95 % intervals.

    ``finished`` and ``covered_98_percent`` count trials.
    """
    enough = f"covered_{100 * ENOUGH_COVERAGE:.0f}_percent"
    rows: list[Mapping[str, Cell]] = [
        {
            **team,
            "trials": len(trials),
            "finished": int(trials["finished"].astype(bool).sum()),
            enough: int((trials["coverage"] >= ENOUGH_COVERAGE).sum()),
            "covered_percent": _times(100.0, mean_of(trials, "coverage")),
            "time_s": mean_of(trials, "time_s"),
            "distance_m": mean_of(trials, "distance_m"),
        }
        for team, trials in _teams(maps)
    ]
    title = f"What explorers cover and what it takes ({MEAN_METHOD}, over seeds)"
    digits = {"covered_percent": 2, "time_s": 1, "distance_m": 1}
    return Table("mapping", title, rows, digits, beside=("distance_m", "finished", "trials"))


def walls_table(maps: Maps) -> Table:
    """A row per arena and team: how right the maps are, means with 95 % intervals."""
    rows: list[Mapping[str, Cell]] = [
        {
            **team,
            "occupied_precision": mean_of(trials, "occupied_precision"),
            "occupied_recall": mean_of(trials, "occupied_recall"),
            "wall_error_cm": _times(100.0, mean_of(trials, "wall_error_m")),
        }
        for team, trials in _teams(maps)
    ]
    title = f"Occupied cells of their maps, within one cell ({MEAN_METHOD}, over seeds)"
    return Table("mapping_walls", title, rows, {"wall_error_cm": 2})


def measures_table(maps: Maps) -> Table:
    """A row per arena, team and measure: mean with its interval, median, and the worst seed."""
    rows: list[Mapping[str, Cell]] = []
    for team, trials in _teams(maps):
        for measure, more_is_better in MEASURES.items():
            defined = trials.dropna(subset=[measure])
            values = sorted(zip(defined[measure].tolist(), defined["seed"].tolist(), strict=True))
            worst, seed = (values[0] if more_is_better else values[-1]) if values else (math.nan, None)
            middle = median([value for value, _ in values]) if values else math.nan
            row: dict[str, Cell] = {**team, "measure": measure, "mean": mean_of(trials, measure)}
            rows.append({**row, "median": middle, "worst": worst, "worst_seed": seed})
    digits = dict.fromkeys(("mean", "median", "worst"), 4)
    bounds = {"mean": ("low", "high", "n")}
    return Table("mapping_measures", "Each measure of the maps", rows, digits, bounds)


def speedup_table(maps: Maps) -> Table:
    """A row per arena and larger team: its time over that of the smallest, summed over the seeds of both.

    The unit of its interval is the seed, both times of a seed together. ``baseline`` is the size
    of the smallest team, ``faster_seeds`` the number of seeds at which the larger one was faster.
    """
    rows: list[Mapping[str, Cell]] = []
    for arena, teams in maps.items():
        baseline, *larger = teams
        for robots in larger:
            pairs = teams[baseline].merge(teams[robots], on="seed", suffixes=("_alone", ""))
            ratio = statistics.ratio_of_sums(pairs["time_s"].tolist(), pairs["time_s_alone"].tolist())
            faster = int((pairs["time_s"] < pairs["time_s_alone"]).sum())
            row: dict[str, Cell] = {"arena": arena, "robots": robots, "baseline": baseline}
            rows.append({**row, "time_ratio": ratio, "faster_seeds": faster, "seeds": len(pairs)})
    title = f"Time of a team over that of the smallest ({MEAN_METHOD}, over seeds)"
    return Table("mapping_speedup", title, rows, bounds={"time_ratio": ("low", "high", "n")})


def choice_table(maps: Maps, gaps: Maps) -> Table:
    """The best maps of each arena, the one to keep as its prior map first, and the worst.

    Of the finished explorations that cover 98 % of the free space within reach, the one with the shortest
    gaps in its walls, in whole centimetres; then the one whose occupied cells have the highest F1 within one
    cell, then the one that covers most, both to four digits; then the smaller wall error, the smaller team,
    the lower seed. The worst is the last of them in this order.
    """
    rows: list[Mapping[str, Cell]] = []
    for arena, teams in maps.items():
        both = pd.concat([trials.assign(robots=robots) for robots, trials in teams.items()])
        both["gaps_m"] = [
            _gaps_m(gaps.get(arena, {}), robots, seed)
            for robots, seed in zip(both["robots"], both["seed"], strict=True)
        ]
        both = both[both["finished"].astype(bool) & (both["coverage"] >= ENOUGH_COVERAGE)]
        precision, recall = both["occupied_precision"], both["occupied_recall"]
        both = both.assign(occupied_f1=(2.0 * precision * recall / (precision + recall)))
        # Python rounds to the nearest decimal number, pandas does not quite
        digits = {name: [round(value, 4) for value in both[name]] for name in ("occupied_f1", "coverage")}
        gaps_cm = (100.0 * both["gaps_m"]).round()
        ranked = both.assign(gaps=gaps_cm, f1=digits["occupied_f1"], covered=digits["coverage"]).sort_values(
            ["gaps", "f1", "covered", "wall_error_m", "robots", "seed"],
            ascending=[True, False, False, True, True, True],
        )
        ranked = ranked[ranked["occupied_f1"].notna()][["robots", "seed", "occupied_f1", *SHOWN]]
        names = ["chosen", *(f"{rank + 1}." for rank in range(1, BEST))]
        shown = list(zip(names, records(ranked.head(BEST)), strict=False))
        if len(ranked) > BEST:
            shown += [("worst", one) for one in records(ranked.tail(1))]
        rows += [{"arena": arena, "choice": name, **one} for name, one in shown]
    order = "by gaps in walls, then occupied F1, then coverage"
    title = f"Best maps, and the worst: finished, {ENOUGH_COVERAGE:.0%} covered; {order}"
    return Table("mapping_choice", title, rows, dict.fromkeys(("occupied_f1", *SHOWN), 4))


def health_table(robots: Maps) -> Table:
    """A row per arena and team: how its robots drove, and how wrong they were about where they ended."""
    rows: list[Mapping[str, Cell]] = []
    for team, each in _teams(robots):
        row: dict[str, Cell] = {**team, "robot_trials": len(each)}
        row |= {name: exact_mean(each[name]) for name in ("distance_m", "stuck_s", "pose_error_m")}
        row["most_pose_error_m"] = max(each["pose_error_m"])
        rows.append(row | {name: int(sum(each[name])) for name in COUNTED})
    digits = {"distance_m": 1, "stuck_s": 1}
    return Table("mapping_health", "How the explorers fared", rows, digits, beside=(*COUNTED, "robot_trials"))


def mean_of(trials: pd.DataFrame, measure: str) -> Estimate:
    """The mean of one measure over trials, with its 95 % interval; shares stay between 0 and 1."""
    is_share = measure in ("coverage", "occupied_precision", "occupied_recall")
    return statistics.mean(trials[measure].tolist(), within=(0.0, 1.0 if is_share else math.inf))


def _times(factor: float, one: Estimate) -> Estimate:
    return Estimate(factor * one.value, factor * one.low, factor * one.high, one.n)


def _gaps_m(teams: Mapping[int, pd.DataFrame], robots: int, seed: int) -> float:
    """Length of all gaps of one trial's map."""
    if robots not in teams:
        return 0.0
    return math.fsum(teams[robots].loc[teams[robots]["seed"] == seed, "length_m"])


def _name(arena: str) -> str:
    """A packaged arena's name, or the one that a file gives it."""
    if not arena.startswith("{"):
        return arena
    try:
        return str(json.loads(arena)["name"])
    except (KeyError, ValueError) as error:
        raise InputError(
            f"arena {shown(arena)}: it has no name; was this campaign written by hand?"
        ) from error
