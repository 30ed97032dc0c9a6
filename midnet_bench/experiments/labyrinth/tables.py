"""The labyrinth's result: success rates by team size (Eq. 11), what lies behind them, the robots' health."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from midnet_bench.analysis.statistics import Estimate, wilson
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.store import FILE_NAME, Store, open_store
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError
from midnet_bench.experiments.labyrinth.trials import (
    GUARD,
    INTRUDER,
    Cells,
    LabyrinthTrial,
    RobotHealth,
    intruder_counts,
    mean,
    number,
    pooled_time,
    rates_by_seed,
    team_sizes,
    variants_of,
)
from midnet_bench.io.files import write_atomically

PAPER_REAL_TIME_FACTOR = 0.18
"""17 simulated hours in 92 hours, section V.B"""

COUNTED = ("goals_reached", "goals_given_up", "collisions", "recoveries", "walls_crossed")


def write_labyrinth_report(store: Store, directory: Path) -> list[Table]:
    """Write the tables and figures of a labyrinth campaign into ``directory``; the tables worth printing."""
    variants = variants_of(store)
    if not variants:
        return []
    tables = {
        "success_rate": success_table(variants),
        "success_rate_cells": cells_table(variants),
        "labyrinth_health": health_table(variants),
        "labyrinth_speed": speed_table(variants),
    }
    for stem, table in tables.items():
        table.write(directory / stem)
    from midnet_bench.experiments.labyrinth.figures import details_figure, png_and_svg, success_figure

    figures = {"success_rate": success_figure(variants)}
    for name, cells in variants.items():
        suffix = f"_{name.replace('=', '-').replace(', ', '_')}" if name else ""
        figures[f"labyrinth_details{suffix}"] = details_figure(cells)
    for stem, figure in figures.items():
        for ending, content in png_and_svg(figure).items():
            write_atomically(directory / f"{stem}{ending}", content)
    return [tables[name] for name in ("success_rate", "labyrinth_health", "labyrinth_speed")]


def write_labyrinth_comparison(
    directories: Sequence[Path], output: Path, names: Sequence[str] | None = None
) -> list[Table]:
    """Several campaigns side by side, ``success_comparison`` as a table and a figure with a panel for each.

    They are called as their folders unless ``names`` are given.

    Raises:
        InputError: one of them is no labyrinth campaign, or two folders have one name.
    """
    variants: dict[str, Cells] = {}
    for campaign, directory in zip(names or [path.name for path in directories], directories, strict=True):
        with open_store(directory / FILE_NAME) as store:
            if store.definition.experiment != "labyrinth":
                raise InputError(f"{directory}: a {store.definition.experiment} campaign beside a labyrinth")
            for name, cells in variants_of(store).items():
                title = f"{campaign}: {name}" if name else campaign
                if title in variants:
                    raise InputError(f"{directory}: another one is named '{campaign}' too")
                variants[title] = cells
    table = success_table(variants)
    table.write(output / "success_comparison")
    from midnet_bench.experiments.labyrinth.figures import png_and_svg, success_figure

    for ending, content in png_and_svg(success_figure(variants)).items():
        write_atomically(output / f"success_comparison{ending}", content)
    return [table]


def success_table(variants: Mapping[str, Cells]) -> Table:
    """The paper's figure in numbers: percent caught with its 95 % interval; rows by number of intruders.

    The last row is over all numbers of intruders; its unit is the seed, because trials of one seed meet
    the same intruders.
    """
    rows: list[Row] = []
    for name, cells in variants.items():
        for intruders in [*intruder_counts(cells), None]:
            row: Row = {"variant": name} if len(variants) > 1 else {}
            row["intruders"] = "all" if intruders is None else str(intruders)
            sizes = set()
            for robots in team_sizes(cells):
                rate = success(cells, intruders, robots)
                row[f"{robots} robot{'s' if robots > 1 else ''}"] = _interval(rate)
                sizes.add(rate.n)
            row["n"] = "-".join(str(n) for n in dict.fromkeys((min(sizes), max(sizes))))
            rows.append(row)
    return Table("Success rate, percent (95 % interval over trials)", rows)


def success(cells: Cells, intruders: int | None, robots: int) -> Estimate:
    """The mean success rate of a cell, percent; over all numbers of intruders if that is None.

    Where all trials caught everybody, or all nobody, no resample differs and the bootstrap would claim
    certainty; there the interval is Wilson's, a trial counting as one yes or no.
    """
    rate = mean(list(rates_by_seed(cells, intruders, robots).values()), "success", intruders or "all", robots)
    if rate.n > 1 and rate.value in (0.0, 100.0):
        proportion = wilson(round(rate.value / 100.0) * rate.n, rate.n)
        return Estimate(rate.value, 100.0 * proportion.low, 100.0 * proportion.high, rate.n)
    return rate


def cells_table(variants: Mapping[str, Cells]) -> Table:
    """A row per cell: rates in percent and times in seconds, each with its 95 % bootstrap interval."""
    rows: list[Row] = []
    for name, cells in variants.items():
        for (intruders, robots), trials in cells.items():
            row: Row = {"variant": name} if len(variants) > 1 else {}
            row |= {"intruders": intruders, "robots": robots, "trials": len(trials)}
            row |= _columns("success_rate", success(cells, intruders, robots))
            row |= _columns("detected_not_caught", not_caught(cells, intruders, robots))
            row |= _columns("time_to_detect_s", pooled_time(trials, "detection_times_s"))
            row |= _columns("time_to_capture_s", pooled_time(trials, "capture_times_s"))
            row |= _columns("duration_s", mean([trial.simulated_s for trial in trials], "duration"))
            rows.append(row)
    return Table("Labyrinth cells", rows)


def not_caught(cells: Cells, intruders: int, robots: int) -> Estimate:
    """The mean share of intruders that were detected and yet not caught, percent."""
    trials = cells.get((intruders, robots), ())
    return mean([trial.detected_not_caught for trial in trials], "not caught", intruders, robots)


def health_table(variants: Mapping[str, Cells]) -> Table:
    """How guards and intruders drove, by team size: per robot and trial, over all numbers of intruders."""
    rows: list[Row] = []
    for name, cells in variants.items():
        for robots in team_sizes(cells):
            trials = [trial for (_, size), group in cells.items() if size == robots for trial in group]
            for role in (GUARD, INTRUDER):
                row: Row = {"variant": name} if len(variants) > 1 else {}
                row |= {"robots": robots, "role": role}
                rows.append(
                    row | _health([one for trial in trials for one in trial.health if one.role == role])
                )
    digits = {"goals_reached": 2, "goals_given_up": 2, "recoveries": 2, "metres_per_minute": 1}
    return Table("Health of the robots", rows, digits | {"stuck_percent": 1, "most_stuck_percent": 1})


def _health(robots: Sequence[RobotHealth]) -> Row:
    present_s = sum(robot.present_s for robot in robots)
    total = {
        name: sum(number(robot.row[name]) for robot in robots) for name in ("distance_m", "stuck_s", *COUNTED)
    }
    row: Row = {
        "robot_trials": len(robots),
        "metres_per_minute": 60.0 * total["distance_m"] / present_s,
        "stuck_percent": 100.0 * total["stuck_s"] / present_s,
        "most_stuck_percent": max(robot.stuck_percent for robot in robots),
    }
    return row | {name: total[name] / len(robots) for name in COUNTED}


def speed_table(variants: Mapping[str, Cells]) -> Table:
    """What a simulated second costs in seconds of one core's time, by the number of robots in the arena."""
    by_robots: dict[int, list[LabyrinthTrial]] = {}
    for cells in variants.values():
        for (intruders, robots), trials in cells.items():
            by_robots.setdefault(intruders + robots, []).extend(trials)
    groups = [(str(count), by_robots[count]) for count in sorted(by_robots)]
    everything = [trial for _, trials in groups for trial in trials]
    rows: list[Row] = []
    for count, trials in [*groups, ("all", everything)]:
        simulated_s = sum(trial.simulated_s for trial in trials)
        wall_s = sum(trial.wall_s for trial in trials)
        row: Row = {"robots_in_arena": count, "trials": len(trials)}
        row |= {"simulated_s": simulated_s, "wall_s": wall_s, "wall_per_simulated": wall_s / simulated_s}
        rows.append(row | {"real_time_factor": simulated_s / wall_s, "paper": PAPER_REAL_TIME_FACTOR})
    return Table(
        "Speed of one worker", rows, {"simulated_s": 0, "wall_s": 0, "real_time_factor": 1, "paper": 2}
    )


def _columns(name: str, estimate: Estimate) -> Row:
    return {name: estimate.value, f"{name}_low": estimate.low, f"{name}_high": estimate.high}


def _interval(rate: Estimate) -> str:
    if rate.n == 0:
        return "n/a"
    return f"{rate.value:.1f}" if rate.n == 1 else f"{rate.value:.1f} ({rate.low:.0f}-{rate.high:.0f})"
