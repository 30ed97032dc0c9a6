"""Stores of campaigns that never ran: their trials are written down, so every number is known."""

import math
from collections.abc import Callable, Mapping
from pathlib import Path

from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.store import Store, open_or_create
from midnet_bench.campaign.trial import Outcome, Row, Scalar, TrialResult, TrialSpec, encode_tables
from midnet_bench.scoring.frame_counts import Causes

Caught = Callable[[int, int, int], int]  # (intruders, robots, seed) -> how many were caught


def labyrinth_store(
    path: Path,
    caught: Caught,
    *,
    seeds: int = 20,
    grid: dict[str, list[Scalar]] | None = None,
    failed: tuple[int, int, int] | None = None,
    by_engine: Mapping[str, int] | None = None,
) -> Store:
    """Trials in which every intruder is detected at 10 s; caught ones at 20 s, the others escape at 60 s."""
    grid = grid or {"intruders": [1, 2, 3, 4, 5], "robots": [1, 2, 3, 4, 5]}
    store = open_or_create(path, Definition("labyrinth", 1, seeds, grid, {}))
    run_id = store.begin_run(collect(1))
    cells: list[dict[str, Scalar]] = [{}]
    for factor, values in grid.items():
        cells = [{**cell, factor: value} for cell in cells for value in values]
    for cell in cells:
        intruders, robots = cell["intruders"], cell["robots"]
        assert isinstance(intruders, int)
        assert isinstance(robots, int)
        for seed in range(1, seeds + 1):
            spec = TrialSpec("labyrinth", cell, seed)
            if (intruders, robots, seed) == failed:
                store.record(run_id, spec, Outcome(spec.trial_id, 1.0, failure="ValueError: no"))
                continue
            number = caught(intruders, robots, seed) if by_engine is None else by_engine[str(cell["engine"])]
            result = labyrinth_result(intruders, robots, number)
            store.record(run_id, spec, Outcome(spec.trial_id, 6.0, result.simulated_s, encode_tables(result)))
    return store


def labyrinth_result(intruders: int, robots: int, caught: int) -> TrialResult:
    duration_s = 20.0 if caught == intruders else 60.0
    outcomes: list[Row] = [
        {
            "intruder": k,
            "outcome": "caught" if k <= caught else "escaped",
            "detected_at_s": 10.0,
            "caught_at_s": 20.0 if k <= caught else math.nan,
            "escaped_at_s": math.nan if k <= caught else 60.0,
            "left_at_s": 20.0 if k <= caught else 60.0,
            "straight_m": 9.0,
        }
        for k in range(1, intruders + 1)
    ]
    health: list[Row] = [
        robot_row("guard", duration_s, stuck_s=6.0, goals_given_up=1) for _ in range(robots)
    ] + [robot_row("intruder", 20.0 if k <= caught else 60.0, stuck_s=0.0) for k in range(1, intruders + 1)]
    trial: Row = {
        "caught": caught,
        "detected": intruders,
        "escaped": intruders - caught,
        "success_rate": 100.0 * caught / intruders,
        "duration_s": duration_s,
        "ended": "nobody left",
        "patrol_relaxations": 0,
        "targets": intruders,
        "ghost_targets": 0,
        "false_target_s": 0.0,
    }
    return TrialResult({"trial": [trial], "intruders": outcomes, "robots": health}, duration_s)


NO_CAUSES: Row = {
    **dict.fromkeys(Causes._fields, 0),
    "patrol_relaxations": 0,
}


def robot_row(role: str, present_s: float, stuck_s: float, goals_given_up: int = 0) -> Row:
    return {
        "robot": role,
        "role": role,
        "distance_m": 0.2 * present_s,
        "goals_reached": 2,
        "goals_given_up": goals_given_up,
        "stuck_s": stuck_s,
        "collisions": 0,
        "walls_crossed": 0,
        "recoveries": 0,
        "pose_error_m": 0.01,
    }


def detection_store(
    folder: Path,
    scores: Mapping[int, Mapping[int, tuple[float, float, float]]],
    failure: str | None = None,
    counted: Callable[[int, int], Row] = lambda robots, seed: {},
    parameters: Mapping[str, Scalar] | None = None,
) -> Path:
    """Trials of the detection test: team size -> seed -> precision, recall, F1; all fail if ``failure``.

    ``counted``: further columns, or other counts, of a team size and a seed. ``parameters``: of all trials.
    """
    seeds = [seed for by_seed in scores.values() for seed in by_seed]
    definition = Definition(
        "detection", min(seeds), len(set(seeds)), {"robots": list(scores)}, dict(parameters or {})
    )
    folder.mkdir(parents=True, exist_ok=True)
    with open_or_create(folder / "campaign.sqlite", definition) as store:
        run_id = store.begin_run(collect(1))
        for robots, by_seed in scores.items():
            for seed, (precision, recall, f1) in by_seed.items():
                counts: Row = {"frames": 10, "tp": 8, "fp": 2, "fn": 4, "intruders_in_range": 12}
                counts |= {"matched": 6, "duplicates": 2, "missed": 6, "error_sum_m": 0.6, "gospa_m": 5.0}
                row: Row = {**counts, "precision": precision, "recall": recall, "f1": f1}
                row |= NO_CAUSES
                row |= counted(robots, seed)
                frames: list[Row] = [
                    {"frame": 1, **{name: count for name, count in counts.items() if name != "frames"}}
                ]
                robot = robot_row("guard", 0.5 * seed, stuck_s=0.0) | {"collisions": 2}
                tables = {"scores": [row], "frames": frames, "robots": [robot] * robots}
                spec = TrialSpec("detection", {"robots": robots, **definition.parameters}, seed)
                payload = encode_tables(TrialResult(tables, 2.0))
                outcome = Outcome(spec.trial_id, 1.5, 2.0, payload)
                store.record(
                    run_id, spec, Outcome(spec.trial_id, 1.5, failure=failure) if failure else outcome
                )
    return folder
