"""A campaign's recorded trials for the player of ``report.html``."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from midnet_bench.analysis.frames import Results, records
from midnet_bench.arena.arena import arena_names
from midnet_bench.arena.layout import place
from midnet_bench.campaign.definition import SEVERAL, shown_cell
from midnet_bench.campaign.trial import Row, Scalar, beside
from midnet_bench.drawing.scene import FloorPlan
from midnet_bench.errors import InputError
from midnet_bench.experiments.guarded.parameters import FRAME_HZ, GuardParameters, guarded_place
from midnet_bench.experiments.guarded.record import (
    BEAM_STEP,
    CAPTURES,
    ERRORS,
    FRAMES,
    NO_RETURN,
    RecordedBox,
    RecordedFrame,
    RecordedRobot,
)
from midnet_bench.experiments.guarded.tables import packaged_robot, usable_range
from midnet_bench.page.recording import KINDS, STEP_MM, Event, Recording, Rows, tracked
from midnet_bench.robots.turtlebot3 import BURGER

TURN = round(2000.0 * math.pi / STEP_MM)  # a whole turn in the page's steps of angle
NEEDED = (FRAMES, "robots", ERRORS, "trial", "intruders", CAPTURES)
"""tables of which a recording is made; detection has no outcomes, labyrinth no errors"""

Key = tuple[Any, ...]  # values of the grid's factors, and the seed


def recordings(results: Results) -> Iterator[Recording]:
    """Each recorded trial in the campaign's order, made on demand.

    Raises:
        InputError: a recorded frame is damaged.
    """
    there = {name: results.tables.get(name) for name in NEEDED}
    tables = {name: _by_trial(results.factors, frame) for name, frame in there.items()}
    for key, frames in tables[FRAMES].items():
        factors = dict(zip(results.factors, key[:-1], strict=True))
        rows = {name: records(trials[key]) if key in trials else [] for name, trials in tables.items()}
        try:
            made = _recording(results.definition.parameters_of(factors), key[-1], rows)
        except (IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
            which = shown_cell({**factors, "seed": key[-1]})
            raise InputError(
                f"{results.directory}: table '{FRAMES}' ({which}): {str(error)[:80]}; run the trial again"
            ) from error
        yield replace(made, cell=results.teams(frames.head(1))[0], explained=bool(tables[ERRORS]))


def _by_trial(factors: Sequence[str], frame: pd.DataFrame | None) -> dict[Key, pd.DataFrame]:
    """A table's rows by the factors of the grid and the seed; nothing if no trial has it."""
    if frame is None or frame.empty:
        return {}
    groups: Any = frame.groupby([*factors, "seed"], sort=False, dropna=False)
    return {
        tuple(part.item() if hasattr(part, "item") else part for part in key): rows for key, rows in groups
    }


def _recording(given: Mapping[str, Scalar], seed: int, tables: Mapping[str, Sequence[Row]]) -> Recording:
    """One trial, of its parameters and its rows; its cell is still to be named."""
    frames = [RecordedFrame.from_row(row) for row in tables[FRAMES]]
    # the robot's own name, beside the factor of that name if there is one
    names = [str(row.get(beside("robot"), row["robot"])) for row in tables["robots"]]
    team = [(name, row["role"] == "guard") for name, row in zip(names, tables["robots"], strict=True)]
    model = packaged_robot(given) or BURGER
    beams = model.lidar.angles_rad[::BEAM_STEP].tolist()
    has_scans = all(len(scan) in (0, len(beams)) for frame in frames for scan in frame.scans_m)
    words: dict[str, int] = {"": 0}
    size_m, range_m = given.get("local_size_m"), usable_range(given)
    rows: dict[str, Sequence[Rows]] = {
        "robots": _robots(frames, [is_guard for _, is_guard in team]),
        "truths": [
            [
                [_number(truth.name, words), *_sides(truth.box), int(truth.in_range), _index(truth.detection)]
                for truth in frame.truths
            ]
            for frame in frames
        ],
        "found": tracked([[_box(one, one.ally) for one in frame.found] for frame in frames]),
        "detections": tracked([[_box(one, one.truth) for one in frame.detections] for frame in frames]),
        "errors": _errors(len(frames), tables[ERRORS], words),
    }
    return Recording(
        cell="",
        seed=seed,
        plan=_plan(given, seed),
        hz=FRAME_HZ,
        robots=team,
        body=model.body,
        beams=(beams[0], beams[1] - beams[0], 0.02 * max(frame.scan_step_cm for frame in frames)),
        words=[*words][1:],
        frames=rows,
        scans={
            "sensors": [_sensors(frame) if has_scans else () for frame in frames],
            "beams": [_beams(frame) if has_scans else () for frame in frames],
        },
        explained=False,
        window_m=float(size_m) if isinstance(size_m, int | float) else None,  # None where cells differ in it
        range_m=None if range_m is None else float(range_m),
        sensor=model.lidar.mount[:2],
        events=_events(tables["intruders"], tables[CAPTURES]),
        summary="".join(
            f"{trial['caught']} of {len(tables['intruders'])} caught, {trial['escaped']} escaped; "
            f"{trial['ended']} after {float(str(trial['duration_s'])):.1f} s"
            for trial in tables["trial"]
        ),
    )


def _events(outcomes: Sequence[Row], captures: Sequence[Row]) -> list[Event]:
    """What intruders of a labyrinth trial met, in the order of time."""
    guards = {row["intruder"]: row["guard"] for row in captures}
    events = []
    for row in outcomes:
        for what in ("detected", "caught", "escaped"):
            at_s = float(str(row[f"{what}_at_s"]))
            if not math.isnan(at_s):
                by = f" by guard {guards[row['intruder']]}" if what == "caught" else ""
                text = f"intruder {row['intruder']} {what}{by}, {at_s:.1f} s"
                events.append(Event(round(at_s * FRAME_HZ), what, text))
    return sorted(events, key=lambda event: event.frame)


def _number(word: object, words: dict[str, int]) -> int:
    """The place at which a recording has a text, from 1; the empty text, as an empty cell, is 0."""
    text = "" if word is None or word != word else str(word)
    return words.setdefault(text, len(words))


def _index(index: int | None) -> int:
    return 0 if index is None else index + 1


def _steps(length: float) -> int:
    """Metres or radians in the page's steps."""
    return round(1000.0 * length / STEP_MM)


def _sides(box: Sequence[float]) -> tuple[int, int, int, int]:
    """x, y, width and height."""
    x, y, right, top = map(_steps, box)
    return x, y, right - x, top - y


def _box(box: RecordedBox, other: int | None) -> list[int]:
    return [box.guard, *_sides(box.box), _index(other)]


def _turned(steps: int) -> int:
    """The same angle, within half a turn of 0."""
    return (steps + TURN // 2) % TURN - TURN // 2


def _robots(frames: Sequence[RecordedFrame], guards: Sequence[bool]) -> list[Rows]:
    rows: list[Rows] = []
    last = [[number, *[0] * 10] for number in range(len(guards))]
    for frame in frames:
        # what is not there now keeps its last numbers: a difference of 0 costs nothing
        last = [
            _robot(robot, was, is_guard) if robot else [was[0], 0, *was[2:]]
            for robot, was, is_guard in zip(frame.robots, last, guards, strict=True)
        ]
        rows.append(last)
    return rows


def _robot(robot: RecordedRobot, was: Sequence[int], is_guard: bool) -> list[int]:
    x, y, yaw = map(_steps, robot.pose)
    believed_x, believed_y, believed_yaw = map(_steps, robot.believed)
    off = (believed_x - x, believed_y - y, _turned(believed_yaw - yaw)) if is_guard else (0, 0, 0)
    goal = [0, *was[9:]] if robot.goal is None else [1 + robot.pursues, *map(_steps, robot.goal)]
    return [was[0], 1, x, y, was[4] + _turned(yaw - was[4]), *off, *goal]


def _sensors(frame: RecordedFrame) -> Rows:
    at = enumerate(frame.sensors)
    return [[guard, 1, *map(_steps, pose)] if pose else [guard, *[0] * 4] for guard, pose in at]


def _beams(frame: RecordedFrame) -> Rows:
    ranges_m = [range_m for scan in frame.scans_m for range_m in scan]
    per_m = 100.0 / frame.scan_step_cm
    steps = np.array([NO_RETURN if one is None else round(per_m * one) for one in ranges_m], dtype=np.int64)
    return np.stack((np.arange(len(steps)), (steps + 1) // 2), axis=1)


def _errors(frames: int, errors: Sequence[Row], words: dict[str, int]) -> list[list[list[int]]]:
    rows: list[list[list[int]]] = [[] for _ in range(frames)]
    names = ("age_s", "offset_m", "x_min_m", "y_min_m", "x_max_m", "y_max_m")
    for error in errors:
        age_s, offset_m, *sides = (float(str(error[name])) for name in names)
        number = int(str(error["frame"]))
        if number < 1:
            raise ValueError(f"frame {number}: is none")
        who, kind = _number(error["intruder"], words), KINDS.index(str(error["kind"]))
        cause, guard = _number(error["cause"], words), int(str(error["guard"]))
        by = _number(error["by"], words)
        times = (round(100.0 * age_s), _steps(offset_m))
        rows[number - 1].append([who, kind, cause, guard, by, *times, *_sides(sides)])
    return rows


def _plan(given: Mapping[str, Scalar], seed: int) -> FloorPlan:
    known = {name: value for name, value in given.items() if SEVERAL not in str(value)}
    arena = str(known["arena"])
    if arena not in arena_names() and not arena.startswith("{"):
        raise ValueError(f"arena {arena!r} is none")
    scale = float(str(known.get("stationary_scale", GuardParameters.stationary_scale)))
    guarded = guarded_place(arena, scale)
    return FloorPlan.of(guarded, place(guarded, seed, int(str(known["robots"])), 0), seed)
