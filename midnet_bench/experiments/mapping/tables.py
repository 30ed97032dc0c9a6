"""The explorers' results: quality of their maps, how long they take, and the choice of a prior map."""

import json
import math
from collections.abc import Callable, Mapping
from statistics import median

import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.frames import Results, records
from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate, exact_mean
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.trial import shown
from midnet_bench.errors import InputError

MEASURES: Mapping[str, bool] = {  # column of ``maps`` -> whether more is better
    "coverage": True,
    "occupied_precision": True,
    "occupied_recall": True,
    "wall_error_m": False,
    "time_s": False,
    "distance_m": False,
}
ENOUGH_COVERAGE = 0.98  # less of the free space within reach is not a map of the arena
BEST = 3  # maps of each arena that the choice shows
SHOWN = ("gaps_m", "occupied_precision", "occupied_recall", "wall_error_m", "coverage")
"""what it shows of them"""
COUNTED = ("collisions", "walls_crossed", "recoveries", "goals_given_up")

Teams = Mapping[tuple[str, int], pd.DataFrame]
"""(arena, team size) -> the rows of its finished trials, seeds ascending; sizes of one arena ascending"""


def tables(results: Results) -> list[Table]:
    """The tables of a mapping campaign."""
    maps = teams_of(results, "maps")
    if not maps:
        return []
    return [
        teams_table(maps),
        walls_table(maps),
        speedup_table(maps),
        choice_table(maps, teams_of(results, "gaps") if "gaps" in results.tables else {}),
        measures_table(maps),
        health_table(teams_of(results, "robots")),
    ]


def teams_of(results: Results, table: str) -> Teams:
    """The rows of a table by arena (with the grid's other factors, if any) and team size.

    ``robots`` is the team's size in each row, whether or not it is a factor of the grid.
    """
    frame = results.table(table)
    if frame.empty:
        return {}
    names = map(_name, results.column(frame, "arena").map(str))
    others = results.other_factors(frame, "arena", "robots")
    arenas = [", ".join(filter(None, both)) for both in zip(names, others, strict=True)]
    order = list(dict.fromkeys(arenas))
    sizes = results.whole_numbers(frame, "robots").astype(int)
    groups = {
        (str(arena), int(str(size))): rows
        for (arena, size), rows in frame.assign(robots=sizes).groupby([pd.Series(arenas, frame.index), sizes])
    }
    return {key: groups[key] for key in sorted(groups, key=lambda key: (order.index(key[0]), key[1]))}


def teams_table(maps: Teams) -> Table:
    """A row per arena and team: how much it explored and what that took, means with 95 % intervals.

    ``finished`` and ``covered_98_percent`` count trials.
    """
    rows = _rows(
        maps,
        lambda trials: {
            "trials": len(trials),
            "finished": int(trials["finished"].astype(bool).sum()),
            f"covered_{100 * ENOUGH_COVERAGE:.0f}_percent": int(
                (trials["coverage"] >= ENOUGH_COVERAGE).sum()
            ),
            "covered_percent": mean_of(trials, "coverage").times(100.0),
            "time_s": mean_of(trials, "time_s"),
            "distance_m": mean_of(trials, "distance_m"),
        },
    )
    title = f"What explorers cover and what it takes ({MEAN_METHOD}, over seeds)"
    digits = {"covered_percent": 2, "time_s": 1, "distance_m": 1}
    return Table("mapping", title, rows, digits, beside=("distance_m", "finished", "trials"))


def walls_table(maps: Teams) -> Table:
    """A row per arena and team: how right the maps are, means with 95 % intervals."""
    rows = _rows(
        maps,
        lambda trials: {
            "occupied_precision": mean_of(trials, "occupied_precision"),
            "occupied_recall": mean_of(trials, "occupied_recall"),
            "wall_error_cm": mean_of(trials, "wall_error_m").times(100.0),
        },
    )
    title = f"Occupied cells of their maps, within one cell ({MEAN_METHOD}, over seeds)"
    return Table("mapping_walls", title, rows, {"wall_error_cm": 2})


def measures_table(maps: Teams) -> Table:
    """A row per arena, team and measure: mean with its interval, median, and the worst seed."""
    rows: list[Mapping[str, Cell]] = []
    for (arena, robots), trials in maps.items():
        for measure, more_is_better in MEASURES.items():
            defined = trials.dropna(subset=[measure])
            values = sorted(zip(defined[measure].tolist(), defined["seed"].tolist(), strict=True))
            worst, seed = (values[0] if more_is_better else values[-1]) if values else (math.nan, None)
            middle = median([value for value, _ in values]) if values else math.nan
            row: dict[str, Cell] = {"arena": arena, "robots": robots, "measure": measure}
            row["mean"] = mean_of(trials, measure)
            rows.append({**row, "median": middle, "worst": worst, "worst_seed": seed})
    digits = dict.fromkeys(("mean", "median", "worst"), 4)
    bounds = {"mean": ("low", "high", "n")}
    return Table("mapping_measures", "Each measure of the maps", rows, digits, bounds)


def speedup_table(maps: Teams) -> Table:
    """A row per arena and larger team: its time over that of the smallest, summed over the seeds of both.

    The unit of its interval is the seed, both times of a seed together. ``baseline`` is the size
    of the smallest team, ``faster_seeds`` the number of seeds at which the larger one was faster.
    """
    rows: list[Mapping[str, Cell]] = []
    smallest: dict[str, int] = {}
    for (arena, robots), trials in maps.items():
        baseline = smallest.setdefault(arena, robots)
        if robots == baseline:
            continue
        pairs = maps[arena, baseline].merge(trials, on="seed", suffixes=("_alone", ""))
        ratio = statistics.ratio_of_sums(pairs["time_s"].tolist(), pairs["time_s_alone"].tolist())
        faster = int((pairs["time_s"] < pairs["time_s_alone"]).sum())
        row: dict[str, Cell] = {"arena": arena, "robots": robots, "baseline": baseline}
        rows.append({**row, "time_ratio": ratio, "faster_seeds": faster, "seeds": len(pairs)})
    title = f"Time of a team over that of the smallest ({MEAN_METHOD}, over seeds)"
    return Table("mapping_speedup", title, rows, bounds={"time_ratio": ("low", "high", "n")})


def choice_table(maps: Teams, gaps: Teams) -> Table:
    """The best maps of each arena, the one to keep as its prior map first, and the worst.

    Of the finished explorations that cover 98 % of the free space within reach, the one with the shortest
    gaps in its walls, in whole centimetres; then the one whose occupied cells have the highest F1 within one
    cell, then the one that covers most, both to four digits; then the smaller wall error, the smaller team,
    the lower seed. The worst is the last of them in this order.
    """
    lengths_m = {
        (*team, seed): math.fsum(own["length_m"])
        for team, rows in gaps.items()
        for seed, own in rows.groupby("seed")
    }
    rows: list[Mapping[str, Cell]] = []
    for arena in dict.fromkeys(arena for arena, _ in maps):
        trials = pd.concat([own for (place, _), own in maps.items() if place == arena])
        teams = zip(trials["robots"], trials["seed"], strict=True)
        trials = trials.assign(gaps_m=[lengths_m.get((arena, *team), 0.0) for team in teams])
        trials = trials[trials["finished"].astype(bool) & (trials["coverage"] >= ENOUGH_COVERAGE)]
        precision, recall = trials["occupied_precision"], trials["occupied_recall"]
        trials = trials.assign(occupied_f1=2.0 * precision * recall / (precision + recall))
        # Python rounds to the nearest decimal number, pandas does not quite
        f1, covered = ([round(value, 4) for value in trials[name]] for name in ("occupied_f1", "coverage"))
        ranked = trials.assign(gaps=(100.0 * trials["gaps_m"]).round(), f1=f1, covered=covered).sort_values(
            ["gaps", "f1", "covered", "wall_error_m", "robots", "seed"],
            ascending=[True, False, False, True, True, True],
        )
        ranked = ranked[ranked["occupied_f1"].notna()][["robots", "seed", "occupied_f1", *SHOWN]]
        names = ["chosen", *(f"{rank + 1}." for rank in range(1, BEST))]
        best = list(zip(names, records(ranked.head(BEST)), strict=False))
        if len(ranked) > BEST:
            best += [("worst", last) for last in records(ranked.tail(1))]
        rows += [{"arena": arena, "choice": name, **row} for name, row in best]
    order = "by gaps in walls, then occupied F1, then coverage"
    title = f"Best maps, and the worst: finished, {ENOUGH_COVERAGE:.0%} covered; {order}"
    return Table("mapping_choice", title, rows, dict.fromkeys(("occupied_f1", *SHOWN), 4))


def health_table(robots: Teams) -> Table:
    """A row per arena and team: how its robots drove, and how wrong they were about where they ended."""
    rows = _rows(
        robots,
        lambda each: {
            "robot_trials": len(each),
            **{name: exact_mean(each[name]) for name in ("distance_m", "stuck_s", "pose_error_m")},
            "most_pose_error_m": max(each["pose_error_m"]),
            **{name: int(sum(each[name])) for name in COUNTED},
        },
    )
    beside, digits = (*COUNTED, "robot_trials"), {"distance_m": 1, "stuck_s": 1}
    return Table("mapping_health", "How the explorers fared", rows, digits, beside=beside)


def mean_of(trials: pd.DataFrame, measure: str) -> Estimate:
    """The mean of one measure over trials, with its 95 % interval; shares stay between 0 and 1."""
    is_share = measure in ("coverage", "occupied_precision", "occupied_recall")
    return statistics.mean(trials[measure].tolist(), within=(0.0, 1.0 if is_share else math.inf))


def _rows(teams: Teams, cells: Callable[[pd.DataFrame], Mapping[str, Cell]]) -> list[Mapping[str, Cell]]:
    """A row per arena and team; ``cells``: what follows these two of its own rows."""
    return [{"arena": arena, "robots": robots, **cells(own)} for (arena, robots), own in teams.items()]


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
