"""A campaign's recorded trials for the player of ``report.html``."""

import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from midnet_bench.analysis.frames import Results, records
from midnet_bench.arena.arena import arena_names
from midnet_bench.arena.layout import place
from midnet_bench.campaign.definition import differs_between_cells, shown_cell
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.drawing.scene import FloorPlan
from midnet_bench.errors import InputError
from midnet_bench.experiments.guarded.parameters import FRAME_HZ, GuardParameters
from midnet_bench.experiments.guarded.record import (
    BEAM_STEP,
    ERRORS,
    FRAMES,
    NO_RETURN,
    RecordedFrame,
    RecordedRobot,
)
from midnet_bench.page.recording import KINDS, STEP_MM, Recording, Rows, tracked
from midnet_bench.robots.burger import BURGER
from midnet_bench.robots.model import RobotModel
from midnet_bench.robots.seams import ROBOTS

TURN = round(2000.0 * math.pi / STEP_MM)
"""a whole turn in the page's steps of angle"""


Key = tuple[Any, ...]
"""values of the grid's factors, and the seed"""


def recordings(results: Results) -> Iterator[Recording]:
    """Each recorded trial in the campaign's order; see :func:`keyed_recordings`."""
    return (recording for _, recording in keyed_recordings(results))


def keyed_recordings(results: Results) -> Iterator[tuple[Key, Recording]]:
    """Each recorded trial in the campaign's order with its key, made on demand.

    Raises:
        InputError: a recorded frame is damaged.
    """
    robots, errors = by_trial(results, "robots"), by_trial(results, ERRORS)
    for key, trial in by_trial(results, FRAMES).items():
        given = results.definition.parameters_of(dict(zip(results.factors, key[:-1], strict=True)))
        cell = results.teams(trial.head(1))[0]
        try:
            yield key, _recording(cell, key[-1], given, trial, robots[key], errors.get(key), bool(errors))
        except (IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
            which = shown_cell({**dict(zip(results.factors, key[:-1], strict=True)), "seed": key[-1]})
            raise InputError(
                f"{results.directory}: table '{FRAMES}' ({which}): {str(error)[:80]}; run the trial again"
            ) from error


def by_trial(results: Results, table: str) -> dict[Key, pd.DataFrame]:
    """A table's rows by the factors of the grid and the seed; nothing if no trial has it."""
    frame = results.tables.get(table)
    if frame is None or frame.empty:
        return {}
    place_of = [*results.factors, "seed"]
    return {_plain(key): rows for key, rows in frame.groupby(place_of, sort=False, dropna=False)}


def _plain(key: Hashable) -> Key:
    parts = key if isinstance(key, tuple) else (key,)
    return tuple(part.item() if hasattr(part, "item") else part for part in parts)


def _recording(
    cell: str,
    seed: int,
    given: Mapping[str, Scalar],
    frames: pd.DataFrame,
    robots: pd.DataFrame,
    errors: pd.DataFrame | None,
    explained: bool,
) -> Recording:
    team = list(zip(robots["robot"].tolist(), (robots["role"] == "guard").tolist(), strict=True))
    recorded = [RecordedFrame.from_row(row) for row in records(frames)]
    model = _model(given)
    words = _Words()
    beams = model.lidar.angles_rad[::BEAM_STEP].tolist()
    has_scans = all(len(scan) in (0, len(beams)) for one in recorded for scan in one.scans_m)
    return Recording(
        cell=cell,
        seed=seed,
        plan=_plan(given, seed),
        hz=FRAME_HZ,
        robots=team,
        body=model.body,
        beams=(beams[0], beams[1] - beams[0]),
        words=words.known,
        frames={
            "robots": _robots(recorded, [is_guard for _, is_guard in team]),
            "truths": [
                [
                    [words.number(name), *_sides(box), int(in_range), _number(detection)]
                    for name, box, in_range, detection in one.truths
                ]
                for one in recorded
            ],
            "found": tracked(
                [[[box.guard, *_sides(box.box), _number(box.ally)] for box in one.found] for one in recorded]
            ),
            "detections": tracked(
                [
                    [[box.guard, *_sides(box.box), _number(box.truth)] for box in one.detections]
                    for one in recorded
                ]
            ),
            "errors": _errors(len(recorded), [] if errors is None else records(errors), words),
        },
        scans=_scans(recorded)
        if has_scans
        else {"sensors": [()] * len(recorded), "beams": [()] * len(recorded)},
        explained=explained,
        window_m=_length(given, "local_size_m"),
        range_m=_length(given, "obstacle_range_m"),
        sensor=model.lidar.mount[:2],
    )


def _length(given: Mapping[str, Scalar], name: str) -> float | None:
    """A parameter in metres; None where results of an older version lack it, or cells differ in it."""
    value = given.get(name)
    return float(value) if isinstance(value, int | float) else None


class _Words:
    """Texts and the places at which a recording has them, from 1; the empty text is 0."""

    def __init__(self) -> None:
        self.known: list[str] = []
        self._numbers: dict[str, int] = {"": 0}

    def number(self, word: object) -> int:
        text = "" if word is None or word != word else str(word)
        if text not in self._numbers:
            self.known.append(text)
            self._numbers[text] = len(self.known)
        return self._numbers[text]


def _steps(length: float) -> int:
    """Metres or radians in the page's steps."""
    return round(1000.0 * length / STEP_MM)


def _number(index: int | None) -> int:
    return 0 if index is None else index + 1


def _sides(box: Sequence[float]) -> tuple[int, int, int, int]:
    """x, y, width and height."""
    x, y, right, top = map(_steps, box)
    return x, y, right - x, top - y


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


def _scans(frames: Sequence[RecordedFrame]) -> dict[str, list[Rows]]:
    return {
        "sensors": [
            [
                [guard, 1, *map(_steps, at)] if at else [guard, *[0] * 4]
                for guard, at in enumerate(frame.sensors)
            ]
            for frame in frames
        ],
        "beams": [_beams([range_m for scan in frame.scans_m for range_m in scan]) for frame in frames],
    }


def _beams(ranges_m: Sequence[float | None]) -> Rows:
    cm = np.array(
        [NO_RETURN if range_m is None else round(100.0 * range_m) for range_m in ranges_m], dtype=np.int64
    )
    return np.stack((np.arange(len(cm)), (cm + 1) // 2), axis=1)


def _errors(frames: int, errors: Sequence[Row], words: _Words) -> list[list[list[int]]]:
    rows: list[list[list[int]]] = [[] for _ in range(frames)]
    for error in errors:
        sides = [float(str(error[side])) for side in ("x_min_m", "y_min_m", "x_max_m", "y_max_m")]
        number = int(str(error["frame"]))
        if number < 1:
            raise ValueError(f"frame {number}: is none")
        rows[number - 1].append(
            [
                words.number(error["intruder"]),
                KINDS.index(str(error["kind"])),
                words.number(error["cause"]),
                int(str(error["guard"])),
                words.number(error["by"]),
                round(100.0 * float(str(error["age_s"]))),
                _steps(float(str(error["offset_m"]))),
                *_sides(sides),
            ]
        )
    return rows


def _model(given: Mapping[str, Scalar]) -> RobotModel:
    """The robot if it comes with the package: no file is run to show results."""
    name = str(given.get("robot", ""))
    return ROBOTS.make(name) if name in ROBOTS.own else BURGER


def _plan(given: Mapping[str, Scalar], seed: int) -> FloorPlan:
    known = {name: value for name, value in given.items() if not differs_between_cells(value)}
    arena, plain = str(known["arena"]), GuardParameters()
    if arena not in arena_names() and not arena.startswith("{"):
        raise ValueError(f"arena {arena!r} is none")
    scale = float(str(known.get("stationary_scale", plain.stationary_scale)))
    guarded = replace(plain, arena=arena, stationary_scale=scale).guarded_place
    return FloorPlan.of(guarded, place(guarded, seed, int(str(known["robots"])), 0), seed)
