"""``errors``: the causes of a recorded campaign's misses and false positives."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from midnet_bench.analysis.frames import Results, load_results, records
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.trial import Row
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.guarded.record import RecordedFrame
from midnet_bench.experiments.guarded.tables import by_frame, error_tables, without
from midnet_bench.experiments.registry import DETECTION, tables_of
from midnet_bench.scoring.error_causes import FALSE_CAUSES, MISS_CAUSES
from midnet_bench.workflows.render import render_trial

WORST = 10  # frames that ``errors`` names
FRAME_S = 0.2
NAMES = {
    "miss": ("missed", "miss", "misses"),
    "false": ("false positive", "false positive", "false positives"),
    "fragment": ("second box", "second box", "second boxes"),
}
"""kind of an error -> in a sentence, one of them, several"""
VERSUS = ("kind", "cause", "both", "only_first", "only_second")
_NUMBERS = ("x_min_m", "y_min_m", "x_max_m", "y_max_m", "age_s", "offset_m")
_BY_POSE = {"pose_error", "misplaced_by_pose", "wall_by_pose"}


def errors(directory: str | Path, where: Sequence[str] = (), seed: int | None = None) -> list[Table]:
    """The causes of a recorded campaign's errors with their shares, counterfactuals, and the worst frames.

    Args:
        directory: of the campaign.
        where: ``FACTOR=VALUE`` of the grid, to look at these trials only.
        seed: to look at this seed's only.

    Raises:
        InputError: the trials were not recorded, or there are no such trials.
    """
    results = _recorded(directory, where)
    if seed is not None:
        results = _of_seed(results, seed)
    return [*error_tables(results), _worst_frames(results)]


def explain(directory: str | Path, seed: int | None, frame: int, where: Sequence[str] = ()) -> Table:
    """The errors of one frame of one trial, one row each; ``line`` is the row in words.

    Args:
        directory: of the campaign.
        seed: of the trial; the campaign's only one unless given.
        frame: counted from 1.
        where: ``FACTOR=VALUE`` of the grid, as many as it takes to name one trial.

    Raises:
        InputError: the trials were not recorded, several match, or there is no such trial or frame.
    """
    results = _of_seed(_recorded(directory, where), seed)
    seed = results.definition.base_seed
    if "recorded" not in results.tables or results.tables["recorded"].empty:
        raise InputError(f"{directory}: trials with an oracle record no frames; add --where oracle=none")
    frames = results.tables["recorded"]
    chosen = frames[frames["frame"] == frame]
    if len(chosen) > 1:
        several = " or ".join(dict.fromkeys(results.other_factors(chosen)))[:200]
        raise InputError(f"{directory}: several trials have seed {seed}; name one by --where: {several}")
    if chosen.empty:
        raise InputError(f"--frame {frame}: the trial has frames 1 to {int(frames['frame'].max())}")
    recorded = RecordedFrame.from_row(records(chosen)[0])
    table = _errors_of(results)
    found = records(table[table["frame"] == frame])
    names = ("kind", "cause", "guard", "intruder")
    rows = [{"line": _sentence(row, recorded), **{name: row[name] for name in names}} for row in found]
    return Table("explanation", _summary(recorded, seed, found), rows)


def grids(
    directory: str | Path, seed: int | None, frame: int, where: Sequence[str], output: Path
) -> list[Path]:
    """The files written to ``output``: one frame of a trial in pictures, each guard's grids A to D too.

    Grids are not recorded: the trial runs again up to that frame, as :func:`~.render.render_trial` says.

    Raises:
        InputError: as :func:`explain`.
    """
    explain(directory, seed, frame, where)
    definition = _of_seed(_recorded(directory, where), seed).definition
    if definition.grid:
        raise InputError(f"{directory}: name one value of {', '.join(definition.grid)} by --where")
    parameters = {**definition.parameters, "record": False}
    return render_trial(definition.experiment, parameters, definition.base_seed, output, frame, clip=False)


def versus(
    directory: str | Path, other: str | Path, where: Sequence[str] = (), other_where: Sequence[str] = ()
) -> Table:
    """Errors that two recorded campaigns both have, and those of one alone, by cause; in the frames of both.

    An intruder is missed by both in a frame if neither has a box of its own on it; two boxes are the same
    error if they have some area in common.

    Raises:
        InputError: one was not recorded, or they have no recorded frame in common.
    """
    names = [str(directory), str(other)]
    both = [_recorded(directory, where), _recorded(other, other_where)]
    frames = []
    for name, results in zip(names, both, strict=True):
        if results.factors:
            raise InputError(f"{name}: name one value of {', '.join(results.factors)} by --where")
        each = results.table("frames")
        frames.append(set(zip(each["seed"].tolist(), each["frame"].tolist(), strict=True)))
    shared = frames[0] & frames[1]
    if not shared:
        raise InputError(f"{names[0]} and {names[1]} have no seed and frame in common")
    one, two = (
        {frame: found for frame, found in by_frame(_errors_of(results)).items() if frame in shared}
        for results in both
    )
    only_one = [error for frame, found in one.items() for error in without(found, two.get(frame, ()))]
    only_two = [error for frame, found in two.items() for error in without(found, one.get(frame, ()))]
    every = [error for found in one.values() for error in found]
    counts = [Counter((error.kind, error.cause) for error in each) for each in (every, only_one, only_two)]
    lines: list[tuple[Any, ...]] = [
        (*key, counts[0][key] - counts[1][key], counts[1][key], counts[2][key])
        for key in dict.fromkeys([*counts[0], *counts[2]])
    ]
    lines.sort(key=lambda line: -max(line[2:]))
    lines.append(("all", "", len(every) - len(only_one), len(only_one), len(only_two)))
    rows = [dict(zip(VERSUS, line, strict=True)) for line in lines]
    title = f"Errors of {names[0]} (first) and {names[1]} (second) in {len(shared)} frames"
    return Table("errors_versus", title, rows)


def narrowed(results: Results, where: Sequence[str]) -> Results:
    """The campaign's trials of some cells: ``where`` has ``FACTOR=VALUE`` of its grid. Raises InputError."""
    for each in where:
        factor, is_there, value = each.partition("=")
        if not is_there:
            raise InputError(f"--where {each}: FACTOR=VALUE is needed, such as robots=5")
        fixed = results.definition.parameters
        if factor in fixed and factor not in results.factors:
            if str(fixed[factor]) != value:
                raise InputError(f"--where {each}: {results.directory} has {factor}={fixed[factor]} alone")
            continue
        parts = results.by_value(factor)
        if value not in parts:
            raise InputError(f"--where {each}: the grid has no such value{nearest_name(value, list(parts))}")
        results = parts[value]
    return results


def _recorded(directory: str | Path, where: Sequence[str]) -> Results:
    results = narrowed(load_results(Path(directory), tables_of), where)
    if not any(name in results.tables and len(results.tables[name]) for name in ("recorded", "errors")):
        raise InputError(f"{directory}: its trials were not recorded; run them with --record")
    if "frames" not in results.tables:
        raise InputError(
            f"{directory}: only the detection test's errors are explained; 'report' plays these trials"
        )
    return results


def _of_seed(results: Results, seed: int | None) -> Results:
    """The trials of one seed; the only one unless given. Raises InputError."""
    known = sorted(set(results.table("frames")["seed"].tolist()))
    has = f"{results.directory} has seeds {known[0]} to {known[-1]}"
    if seed is None and len(known) > 1:
        raise InputError(f"--frame: {has}; name one by --seed")
    seed = known[0] if seed is None else seed
    if seed not in known:
        raise InputError(f"--seed {seed}: was not recorded; {has}")
    return results.of_seed(seed)


def _errors_of(results: Results) -> pd.DataFrame:
    found = results.tables.get("errors")
    if found is None:  # no trial had any
        return pd.DataFrame(columns=["seed", *DETECTION.columns["errors"].columns])
    return found


def _worst_frames(results: Results) -> Table:
    """The frames with most errors, the worst first."""
    found = _errors_of(results)
    rows: list[Mapping[str, Cell]] = []
    if len(found):
        frames = found.assign(trial=results.teams(found)).groupby(["trial", "seed", "frame"], sort=False)
        counts = frames.size().sort_values(ascending=False, kind="stable").head(WORST)
        for row in records(counts.reset_index(name="errors")):
            causes = frames["cause"].get_group((row["trial"], row["seed"], row["frame"])).value_counts()
            rows.append({**row, "causes": ", ".join(f"{count} {cause}" for cause, count in causes.items())})
    return Table("worst_frames", "Frames with most errors", rows)


def _summary(recorded: RecordedFrame, seed: int, found: Sequence[Row]) -> str:
    kinds = Counter(str(row["kind"]) for row in found)

    def counted(count: int, one: str, several: str) -> str:
        return f"{count} {one if count == 1 else several}"

    in_range = counted(sum(truth.in_range for truth in recorded.truths), "intruder", "intruders")
    errors = ", ".join(counted(kinds[kind], one, several) for kind, (_, one, several) in NAMES.items())
    return (
        f"seed {seed}, frame {recorded.number} ({recorded.number * FRAME_S:.1f} s): {in_range} in range, "
        f"{counted(len(recorded.detections), 'box', 'boxes')}: {errors} on an intruder"
    )


def _sentence(row: Row, recorded: RecordedFrame) -> str:
    """One error in a line."""
    kind, cause, guard = str(row["kind"]), str(row["cause"]), int(str(row["guard"]))
    x_min, y_min, x_max, y_max, age_s, offset_m = (float(str(row[name])) for name in _NUMBERS)
    if kind == "miss":
        what, meaning = str(row["intruder"]), MISS_CAUSES[cause]
    else:
        what, meaning = f"{100 * (x_max - x_min):.0f} x {100 * (y_max - y_min):.0f} cm", FALSE_CAUSES[cause]
    details = [f"guard {guard}"] * (guard > 0)
    details += [str(row["by"])] * (isinstance(row["by"], str) and row["by"] != "")
    details += [f"returns {age_s:.2f} s old"] * (age_s > 0.0)
    details += [f"off by {100 * offset_m:.1f} cm"] * (offset_m > 0.0)
    if cause in _BY_POSE and guard and (robot := recorded.robots[guard - 1]) is not None:
        degrees = math.degrees(abs(robot.believed.relative_to(robot.pose).yaw))
        details.append(
            f"pose estimate of guard {guard} off by {100 * robot.pose.distance_to(robot.believed):.1f} cm "
            f"and {degrees:.1f} degrees"
        )
    center = f"({(x_min + x_max) / 2:.2f}, {(y_min + y_max) / 2:.2f}) m"
    return ". ".join(
        [
            f"{NAMES[kind][0]}: {what} at {center}. Cause: {cause} ({meaning})",
            *filter(None, ["; ".join(details)]),
        ]
    )
