"""Tables that guarded trials share: further metrics, and recorded errors with their causes."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.compare import MEASURE, label, series
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.trial import Scalar
from midnet_bench.geometry import Box
from midnet_bench.robots.model import ROBOTS, RobotModel
from midnet_bench.scoring.error_causes import FALSE_CAUSES, MISS_CAUSES, UNEXPLAINED
from midnet_bench.scoring.frame_counts import touches

METRICS = "metrics"  # the table of trials that take some
KINDS = {"miss": MISS_CAUSES, "false": FALSE_CAUSES, "fragment": FALSE_CAUSES}
ORACLE, NONE, ALL = "oracle", "none", "all errors"
REMOVED_BY = {
    "pose": ("pose_error", "misplaced_by_pose", "wall_by_pose"),
    "crop": ("crop_shift", "misplaced_by_crop", "wall_by_crop"),
    "noise": ("range_noise", "misplaced_by_noise", "wall_by_noise", "beyond_range"),
    "map": ("wall_by_map",),
    "delay": ("delay", "stale"),
    "window": ("outside_window",),
    "marks": ("intruder_trail", "ally_trail"),
    "allies": ("taken_for_ally", "ally_left", "ally_trail"),
    "occlusion": ("occluded",),
    "sight": ("occluded_outside_window",),
    "fusion": ("merged", "dropped_by_fusion", "fragment"),
}
"""oracle -> the causes that it takes away"""


def metric_measures(results: Results) -> pd.DataFrame:
    """Each metric of each trial, a frame of scores in the campaign's order; empty without metrics."""
    frame = results.tables.get(METRICS)
    if frame is None or frame.empty:
        return pd.DataFrame()
    frame = frame.assign(robots=results.column(frame, "robots")).rename(columns={"metric": MEASURE})
    return frame[[*dict.fromkeys([*results.factors, "robots"]), "seed", MEASURE, "value"]]


def metric_tables(results: Results) -> list[Table]:
    """A row for each metric of each cell: the mean over seeds and its interval; no table without metrics."""
    frame = metric_measures(results)
    names = [str(name) for name in frame if name not in (MEASURE, "seed", "value")]
    rows: list[Mapping[str, Cell]] = [
        {
            "trial": label(names, key[:-1]),
            "metric": str(key[-1]),
            "value": statistics.mean([*values.values()]),
        }
        for key, values in (series(frame, [*names, MEASURE]) if names else {}).items()
    ]
    title = f"Further metrics ({statistics.MEAN_METHOD}, over seeds)"
    return [Table("metrics_summary", title, rows)] if rows else []


def usable_range(parameters: Mapping[str, Scalar]) -> float | None:
    """How far off intruders are looked for, metres, by a campaign's parameters; None where cells differ.

    Of a robot that no :func:`packaged_robot` is, obstacle_range_m counts as it stands.
    """
    range_m, robot = parameters.get("obstacle_range_m", 2.5), packaged_robot(parameters)
    if not isinstance(range_m, int | float):
        return None
    return range_m if robot is None else min(range_m, robot.lidar.range_max_m)


def packaged_robot(parameters: Mapping[str, Scalar]) -> RobotModel | None:
    """The robot of a campaign's parameters if it comes with the package, else None.

    No file of a user is run to show results.
    """
    robot = str(parameters.get("robot", ""))
    return ROBOTS.make(robot) if robot and ROBOTS.is_own(robot) else None


def error_tables(results: Results) -> list[Table]:
    """The causes and, where trials differ in ``oracle``, the counterfactuals; nothing if not recorded."""
    errors = results.tables.get("errors")
    if errors is None or errors.empty:
        return []
    tables = [_causes(results, errors)]
    if ORACLE in results.factors and NONE in results.definition.grid[ORACLE]:
        tables.append(_counterfactuals(results, errors))
    return tables


def _causes(results: Results, errors: pd.DataFrame) -> Table:
    """A row for each cell, kind and cause: how many, their share of the kind's errors, and of the paper's."""
    rows: list[Mapping[str, Cell]] = []
    notes = []
    for cell, own in errors.assign(cell=results.teams(errors)).groupby("cell", sort=False):
        for kind, known in KINDS.items():
            part = own[own["kind"] == kind]
            by_seed = part.groupby("seed")["cause"]
            counts = part["cause"].value_counts()
            for cause in sorted(counts.index, key=lambda name: (-counts[name], list(known).index(name))):
                shares = [int((causes == cause).sum()) / len(causes) for _, causes in by_seed]
                rows.append(
                    {
                        "trial": str(cell),
                        "kind": kind,
                        "cause": str(cause),
                        "errors": int(counts[cause]),
                        "share": int(counts[cause]) / len(part),
                        "mean_share": statistics.mean(shares, within=(0.0, 1.0)),
                        "paper_errors": int(part.loc[part["cause"] == cause, "paper"].sum()),
                        "meaning": known[str(cause)],
                    }
                )
        unexplained = int((own["cause"] == UNEXPLAINED).sum())
        notes.append(f"{cell}: {unexplained} of {len(own)} errors ({unexplained / len(own):.1%}) unexplained")
    title = f"Causes of errors, by one-to-one matching ({statistics.MEAN_METHOD}, over seeds)"
    beside = ("meaning", "paper_errors", "mean_share")
    return Table("error_causes", title, rows, notes=notes, beside=beside)


class Error(NamedTuple):
    """What of one error tells whether another trial has it too."""

    kind: str
    cause: str
    intruder: str
    box: Box


def _counterfactuals(results: Results, errors: pd.DataFrame) -> Table:
    """A row for each team, oracle and cause that the oracle takes away: which errors are gone, and which new.

    Trials of one seed that differ in ``oracle`` are the same scene, frame by frame. A miss is gone if its
    intruder has a box of its own in that frame; another error if no such box has any area in common with it.
    """
    errors = errors.assign(cell=results.teams(errors, ORACLE))
    grouped = {key: by_frame(part) for key, part in errors.groupby(["cell", ORACLE], sort=False)}
    rows: list[Mapping[str, Cell]] = []
    for team in dict.fromkeys(errors["cell"]):
        base = grouped.get((team, NONE), {})
        every = [error for found in base.values() for error in found]
        for oracle in results.definition.grid[ORACLE]:
            if oracle == NONE or not base:
                continue
            changed = grouped.get((team, oracle), {})
            gone = [e for place, found in base.items() for e in without(found, changed.get(place, ()))]
            new = sum(len(without(found, base.get(place, ()))) for place, found in changed.items())
            for cause in (*REMOVED_BY.get(str(oracle), ()), ALL):
                chosen, removed = (sum(cause in (e.cause, ALL) for e in some) for some in (every, gone))
                row: dict[str, Cell] = {
                    "trial": team,
                    "oracle": str(oracle),
                    "cause": cause,
                    "errors": chosen,
                    "attributed_share": chosen / len(every),
                    "removed": removed,
                    "removed_share": removed / chosen if chosen else None,
                }
                rows.append({**row, "new_errors": new} if cause == ALL else row)
    title = "Counterfactuals: the same scenes, with one cause of errors taken away"
    return Table("counterfactuals", title, rows, beside=("new_errors", "attributed_share"))


def by_frame(errors: pd.DataFrame) -> dict[tuple[int, int], list[Error]]:
    """(seed, frame) -> the errors of a table ``errors`` there; trials of one cell."""
    columns = (errors[name].tolist() for name in ("seed", "frame", "kind", "cause", "intruder"))
    boxes = errors[["x_min_m", "y_min_m", "x_max_m", "y_max_m"]].to_numpy().tolist()
    found: dict[tuple[int, int], list[Error]] = {}
    for seed, frame, kind, cause, intruder, box in zip(*columns, boxes, strict=True):
        found.setdefault((seed, frame), []).append(Error(kind, cause, intruder, Box(*box)))
    return found


def without(errors: Iterable[Error], others: Sequence[Error]) -> list[Error]:
    """Those of ``errors`` that are not among ``others``, errors of the same frame."""

    def is_same(one: Error, other: Error) -> bool:
        if one.kind != other.kind:
            return False
        return one.intruder == other.intruder if one.kind == "miss" else touches(one.box, other.box)

    return [one for one in errors if not any(is_same(one, other) for other in others)]
