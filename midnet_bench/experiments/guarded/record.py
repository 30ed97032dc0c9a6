"""A recorded trial: what happened in it, frame by frame, in numbers small enough to keep and to send."""

import base64
import json
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.campaign.trial import Row
from midnet_bench.geometry import Box, Point, Pose2D

FRAMES, ERRORS, CAPTURES = "recorded", "errors", "captures"  # the tables of a recorded trial
BEAM_STEP = 4  # each fourth beam of a scan is kept
NO_RETURN = 255  # in a recorded scan; other values are whole steps, of a centimetre for up to 2.54 m


class RecordedRobot(NamedTuple):
    """One robot at one frame, map frame."""

    pose: Pose2D  # where it truly is, to the millimetre and milliradian
    believed: Pose2D  # its estimated pose
    goal: Point | None  # where it drives to, metres
    pursues: bool = False  # whether the goal is what it pursues


class RecordedTruth(NamedTuple):
    """One intruder at one frame."""

    name: str
    box: Box
    in_range: bool  # whether missing it counts
    detection: int | None  # the index of the detection that is paired with it


class RecordedBox(NamedTuple):
    """One guard's box before fusion, or one box of the team."""

    guard: int  # index of the guard that it comes from
    box: Box
    ally: int | None = None  # index of the guard that it was removed for, of a box before fusion
    truth: int | None = None  # index of the intruder that is paired with it, of a box of the team


class RecordedFrame(NamedTuple):
    """One frame of a trial; metres and radians, map frame."""

    number: int  # counted from 1, five a second
    robots: list[RecordedRobot | None]  # in the order of the table ``robots``; None for one that is gone
    truths: list[RecordedTruth]
    found: list[RecordedBox]  # empty where a detector explains nothing
    detections: list[RecordedBox]
    scans_m: list[list[float | None]]
    """of each guard the last scan, each fourth beam; None where nothing came back within 254 steps"""
    sensors: list[Pose2D | None]  # where each guard took its LiDAR to be at that scan
    scan_step_cm: int = 1  # what scans are recorded to, see :func:`scan_step_cm`

    def to_row(self) -> Row:
        """A row of the table ``recorded``: lists as JSON in millimetres and milliradians, scans in base64.

        A step of more than a centimetre stands behind the sensor's pose.
        """
        step = self.scan_step_cm
        lists: dict[str, list[list[object] | None]] = {
            "poses": [
                robot and [*_mm((*robot.pose, *robot.believed, *(robot.goal or ()))), *[1] * robot.pursues]
                for robot in self.robots
            ],
            "truths": [[name, *_mm(box), int(near), found] for name, box, near, found in self.truths],
            "found": [[one.guard, *_mm(one.box), one.ally] for one in self.found],
            "detections": [[one.guard, *_mm(one.box), one.truth] for one in self.detections],
        }
        scans = (
            f"{base64.b64encode(_steps(scan, step)).decode()}@{_place(sensor, step)}"
            for scan, sensor in zip(self.scans_m, self.sensors, strict=True)
        )
        texts = {name: json.dumps(rows, separators=(",", ":")) for name, rows in lists.items()}
        return {"frame": self.number, **texts, "scans": " ".join(scans)}

    @classmethod
    def from_row(cls, row: Mapping[str, object]) -> "RecordedFrame":
        """What :meth:`to_row` packed. Raises ValueError if it is damaged."""
        try:
            poses, truths, found, detections = (
                json.loads(str(row[name])) for name in ("poses", "truths", "found", "detections")
            )
            scans, sensors, step = [], list[Pose2D | None](), 1
            for scan, _, place in (scan.partition("@") for scan in str(row["scans"]).split()):
                numbers = list(map(int, place.split(","))) if place else []
                step = numbers[3] if len(numbers) == 4 else step
                steps = base64.b64decode(scan)
                scans.append([None if one == NO_RETURN else one * step / 100.0 for one in steps])
                sensors.append(Pose2D(*(mm / 1000.0 for mm in numbers[:3])) if numbers else None)
            return cls(
                int(str(row["frame"])),
                [None if robot is None else _robot(robot) for robot in poses],
                [
                    RecordedTruth(name, _box(sides), bool(near), detection)
                    for name, *sides, near, detection in truths
                ],
                [RecordedBox(guard, _box(sides), ally=ally) for guard, *sides, ally in found],
                [RecordedBox(guard, _box(sides), truth=truth) for guard, *sides, truth in detections],
                scans,
                sensors,
                step,
            )
        except (IndexError, KeyError, TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"frame {row.get('frame')}: is no recorded frame") from error


def scan_step_cm(range_m: float) -> int:
    """Whole centimetres to which scans are recorded: 254 of them hold the range, a byte for each beam."""
    return max(1, math.ceil(100.0 * range_m / (NO_RETURN - 1) - 1e-9))


def recorded_scan(ranges_m: npt.NDArray[np.float64], step_cm: int = 1) -> list[float | None]:
    """Each fourth beam of a scan as it is recorded: metres, None where nothing came back in 254 steps."""
    far_m = (NO_RETURN - 0.5) * step_cm / 100.0
    return [range_m if 0.0 < range_m < far_m else None for range_m in ranges_m[::BEAM_STEP].tolist()]


def _steps(scan_m: Sequence[float | None], step_cm: int) -> bytes:
    steps = 100.0 * np.array(scan_m, dtype=np.float64) / step_cm  # NaN for None
    return np.where(np.isnan(steps), NO_RETURN, np.rint(steps)).astype(np.uint8).tobytes()


def _place(sensor: Pose2D | None, step_cm: int) -> str:
    """What stands behind a scan: its sensor's pose, and the step unless it is a centimetre."""
    numbers = [] if sensor is None else [*_mm(sensor), *([step_cm] if step_cm > 1 else [])]
    return ",".join(map(str, numbers))


def _mm(numbers: Sequence[float]) -> list[int]:
    return [round(1000.0 * number) for number in numbers]


def _box(numbers: Sequence[int]) -> Box:
    return Box(*(number / 1000.0 for number in numbers))


def _robot(numbers: Sequence[int]) -> RecordedRobot:
    x, y, yaw, *rest = (number / 1000.0 for number in numbers[:8])
    goal = (rest[3], rest[4]) if len(rest) > 3 else None
    return RecordedRobot(Pose2D(x, y, yaw), Pose2D(*rest[:3]), goal, len(numbers) > 8)
