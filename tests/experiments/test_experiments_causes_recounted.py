"""Causes of errors counted anew from recorded trials, by rays and distances worked out here alone.

The truth is taken from the table ``recorded`` alone and from where the arena's solids stand. Where somebody
was between two frames is interpolated.
"""

import math
from collections import Counter, defaultdict
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import Layout, place
from midnet_bench.campaign.trial import Row
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import run_detection
from midnet_bench.experiments.guarded.record import RecordedFrame
from midnet_bench.geometry import Solid

pytestmark = pytest.mark.slow

Floats = npt.NDArray[np.float64]
FRAME_S = 0.2
LIDAR_BACK_M, RADIUS_M = 0.032, 0.055
"""a Burger's LiDAR behind its axle, and the radius of what other LiDARs see of it"""
RANGE_M, WINDOW_M, CELL_M, REACH_M = 2.5, 3.0, 0.05, 0.105
ENOUGH, AGREE = 20, 0.95
"""errors of one cause from which on it is compared, and the share of them that has to agree"""


class World:
    """Everybody's true places at any time of a recorded trial."""

    def __init__(self, tables: dict[str, list[Row]], layout: Layout, robots: int) -> None:
        self.robots = robots
        self.frames = [RecordedFrame.from_row(row) for row in tables["recorded"]]
        self.poses = np.array([[robot.pose for robot in frame.robots if robot] for frame in self.frames])
        self.poses[..., 2] = np.unwrap(self.poses[..., 2], axis=0)
        self.solids: list[tuple[str, Solid]] = [("a wall", wall) for wall in layout.arena.wall_solids()]
        self.solids += [(f"stationary {k}", solid) for k, solid in enumerate(layout.stationary, 1)]
        self.names = [
            f"guard {k + 1}" if k < robots else f"intruder {k - robots + 1}"
            for k in range(self.poses.shape[1])
        ]
        ages = defaultdict(set)
        for row in tables["errors"]:
            if 0.0 < float(str(row["age_s"])) < FRAME_S:
                ages[row["guard"]].add(row["age_s"])
        assert all(len(of_guard) == 1 for of_guard in ages.values())
        self.scan_age_s = {int(str(guard)) - 1: float(str(age.pop())) for guard, age in ages.items()}

    def poses_at(self, frame: int, age_s: float = 0.0) -> Floats:
        """(robots, 3)"""
        at = max(frame - 1 - age_s / FRAME_S, 0.0)
        low = min(int(at), len(self.poses) - 1)
        high = min(low + 1, len(self.poses) - 1)
        return np.asarray(self.poses[low] + (at - low) * (self.poses[high] - self.poses[low]))

    def centre(self, name: str, frame: int, age_s: float) -> Floats:
        """Where the middle of what is seen of somebody was."""
        if name.startswith("stationary"):
            solid = next(solid for known, solid in self.solids if known == name)
            return np.array([solid.pose.x, solid.pose.y])
        return lidars(self.poses_at(frame, age_s))[self.names.index(name)]

    def seen(self, guard: int, frame: int, age_s: float) -> dict[str, Floats]:
        """Whom a guard's 360 beams meet, and where they end, (n, 2) metres."""
        poses = self.poses_at(frame, age_s)
        places = lidars(poses)
        sensor = places[guard]
        angles = poses[guard, 2] + np.radians(np.arange(360))
        ways = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        nearest = np.full(360, np.inf)
        who = np.full(360, "nobody", dtype="<U20")
        for name, solid in self.solids:
            keep(nearest, who, name, to_solid(sensor, ways, solid))
        for k, at in enumerate(places):
            if k != guard:
                keep(nearest, who, self.names[k], to_disc(sensor, ways, at, RADIUS_M))
        ends = sensor + nearest[:, None] * ways
        return {name: ends[(who == name) & (nearest < 3.5)] for name in set(who)}


def keep(nearest: Floats, who: npt.NDArray[np.str_], name: str, ranges_m: Floats) -> None:
    closer = ranges_m < nearest
    nearest[closer], who[closer] = ranges_m[closer], name


def lidars(poses: Floats) -> Floats:
    """(n, 2) of (n, 3) poses"""
    x, y, yaw = poses.T
    return np.stack((x - LIDAR_BACK_M * np.cos(yaw), y - LIDAR_BACK_M * np.sin(yaw)), axis=1)


def to_disc(sensor: Floats, ways: Floats, centre: Floats, radius_m: float) -> Floats:
    off = centre - sensor
    along = ways @ off
    square = radius_m**2 - (off @ off - along**2)
    hits = (square > 0.0) & (along > 0.0)
    return np.where(hits, along - np.sqrt(np.maximum(square, 0.0)), np.inf)


def to_solid(sensor: Floats, ways: Floats, solid: Solid) -> Floats:
    centre = np.array([solid.pose.x, solid.pose.y])
    if solid.kind == "cylinder":
        return to_disc(sensor, ways, centre, solid.length_m / 2.0)
    c, s = math.cos(solid.pose.yaw), math.sin(solid.pose.yaw)
    turn = np.array([[c, s], [-s, c]])
    start, turned = turn @ (sensor - centre), ways @ turn.T
    half = np.array([solid.length_m, solid.width_m]) / 2.0
    with np.errstate(divide="ignore"):
        one, two = (-half - start) / turned, (half - start) / turned
    enter, leave = np.minimum(one, two).max(axis=1), np.maximum(one, two).min(axis=1)
    return np.where((leave >= enter) & (enter > 0.0), enter, np.inf)


def gap_m(box: tuple[float, ...], x: float, y: float) -> float:
    return math.hypot(max(box[0] - x, 0.0, x - box[2]), max(box[1] - y, 0.0, y - box[3]))


def in_window(frame: RecordedFrame, guard: int, ends: Floats) -> npt.NDArray[np.bool_]:
    """Of true places, whether the guard puts them into the window about itself."""
    robot = frame.robots[guard]
    turn = robot.believed.yaw - robot.pose.yaw
    c, s = math.cos(turn), math.sin(turn)
    off = ends - robot.pose[:2]
    put = np.array(robot.believed[:2]) + off @ np.array([[c, s], [-s, c]])
    low = (np.floor(np.array(robot.believed[:2]) / CELL_M) - WINDOW_M / CELL_M / 2.0) * CELL_M
    return np.asarray(((put >= low) & (put < low + WINDOW_M)).all(axis=1))


def agrees(world: World, row: Row) -> bool:
    """Whether an error has what its cause takes."""
    cause, number = str(row["cause"]), int(str(row["frame"]))
    frame = world.frames[number - 1]
    by, age_s, guard = str(row["by"]), float(str(row["age_s"])), int(str(row["guard"])) - 1
    area = tuple(float(str(row[name])) for name in ("x_min_m", "y_min_m", "x_max_m", "y_max_m"))
    if row["kind"] == "miss":
        return agrees_on_miss(world, frame, row, area)
    if cause == "fragment":
        return any(
            truth.name == by and truth.detection is not None and overlap(area, truth.box)
            for truth in frame.truths
        )
    if any(overlap(area, truth.box) for truth in frame.truths):
        return False
    if cause in ("ally_left", "ally_trail", "intruder_trail"):
        centre = world.centre(by, number, age_s)
        is_new = age_s < FRAME_S
        # the return, the cells about it, and by how much they can be off together
        return is_new == (cause == "ally_left") and gap_m(area, *centre) < RADIUS_M + REACH_M + 2 * CELL_M
    if cause.startswith("wall"):
        middle = np.array([[(area[0] + area[2]) / 2.0, (area[1] + area[3]) / 2.0]])
        walls = min(solid.distance_to(middle)[0] for name, solid in world.solids if name == "a wall")
        return bool(walls < 0.5)
    truth = next(truth for truth in frame.truths if truth.name == by)
    if cause == "stale":
        return bool(
            overlap(area, shifted(truth.box, world.centre(by, number, age_s) - world.centre(by, number, 0.0)))
        )
    moved = cell(frame.robots[guard].believed[:2]) != cell(base(frame, guard))  # type: ignore[union-attr]
    near = gap_m(area, *world.centre(by, number, age_s)) < RADIUS_M + 0.5
    return near and (moved if cause == "misplaced_by_crop" else True)


def agrees_on_miss(world: World, frame: RecordedFrame, row: Row, area: tuple[float, ...]) -> bool:
    """Whether rays say of a missed intruder what its cause says."""
    cause, name, number = str(row["cause"]), str(row["intruder"]), frame.number
    near = [g for g in range(world.robots) if gap_m(area, *lidars(world.poses_at(number))[g]) <= RANGE_M]
    if cause == "merged":
        return any(overlap(area, detection.box) for detection in frame.detections)
    if any(overlap(area, detection.box) for detection in frame.detections):
        return False
    now = {g: world.seen(g, number, 0.0) for g in near}
    then = {g: world.seen(g, number, world.scan_age_s.get(g, 0.0)) for g in near}
    met_now, met_then = ([g for g in near if name in seen[g]] for seen in (now, then))
    if cause.startswith("occluded"):
        return not met_then and not met_now
    if cause == "outside_window":
        met = [(g, then[g].get(name, now[g].get(name))) for g in {*met_now, *met_then}]
        return bool(met) and not any(in_window(frame, g, ends).any() for g, ends in met)
    if cause == "delay":
        by = int(str(row["guard"])) - 1
        if row["offset_m"] == 0.0:
            return by in met_now and by not in met_then
        return by in met_then
    return int(str(row["guard"])) - 1 in met_then


def overlap(one: tuple[float, ...], two: tuple[float, ...]) -> bool:
    return one[0] < two[2] and two[0] < one[2] and one[1] < two[3] and two[1] < one[3]


def shifted(area: tuple[float, ...], by: Floats) -> tuple[float, ...]:
    return area[0] + by[0], area[1] + by[1], area[2] + by[0], area[3] + by[1]


def base(frame: RecordedFrame, guard: int) -> tuple[float, float]:
    """Where a guard took itself to be at its last scan."""
    sensor = frame.sensors[guard]
    return (sensor.x + LIDAR_BACK_M * math.cos(sensor.yaw), sensor.y + LIDAR_BACK_M * math.sin(sensor.yaw))


def cell(place: tuple[float, ...]) -> tuple[int, ...]:
    return tuple(math.floor(value / CELL_M) for value in place)


@cache
def recorded(seed: int, robots: int, frames: int, **options: object) -> tuple[World, dict[str, list[Row]]]:
    values = {"engine": "fast", "record": True, "frames": frames, "robots": robots, **options}
    tables = run_detection(DetectionParameters.of(**values).with_files_read(), seed).tables
    return World(tables, place(load_arena("map1"), seed, robots), robots), tables


def shares(world: World, tables: dict[str, list[Row]]) -> dict[str, tuple[int, int]]:
    """Of each cause, how many errors agree, and how many there are."""
    counts: Counter[str] = Counter()
    agreed: Counter[str] = Counter()
    for row in tables["errors"]:
        counts[str(row["cause"])] += 1
        agreed[str(row["cause"])] += agrees(world, row)
    return {cause: (agreed[cause], count) for cause, count in counts.items()}


ALONE: dict[str, Any] = {"seed": 11, "robots": 1, "frames": 120}
TEAM: dict[str, Any] = {
    **{"seed": 13, "robots": 5, "frames": 60},
    **{"local_map": "persistent", "inf_is_valid": False, "iou_ally": 0.1},
}


@pytest.mark.parametrize(("trial", "causes"), [(ALONE, 2), (TEAM, 5)])
def test_an_independent_count_agrees_on_every_error_and_its_cause(trial: dict[str, Any], causes: int) -> None:
    every_error_is_one_of_those_that_are_counted(*recorded(**trial))
    found = shares(*recorded(**trial))
    enough = {cause: (agreed, count) for cause, (agreed, count) in found.items() if count >= ENOUGH}
    assert len(enough) >= causes
    assert {cause: pair for cause, pair in enough.items() if pair[0] < AGREE * pair[1]} == {}


def told_by_rays(world: World, tables: dict[str, list[Row]]) -> Counter[tuple[str, bool]]:
    """Of misses that rays call hidden, or outside all windows, how many have such a cause, how many not."""
    told: Counter[tuple[str, bool]] = Counter()
    for row in tables["errors"]:
        if row["kind"] != "miss" or row["cause"] == "merged":
            continue
        frame = world.frames[int(str(row["frame"])) - 1]
        truth = next(truth for truth in frame.truths if truth.name == row["intruder"])
        places = lidars(world.poses_at(frame.number))
        near = [g for g in range(world.robots) if gap_m(truth.box, *places[g]) <= RANGE_M]
        then = {g: world.seen(g, frame.number, world.scan_age_s.get(g, 0.0)) for g in near}
        met = {g: seen[truth.name] for g, seen in then.items() if truth.name in seen}
        if not met and not any(truth.name in world.seen(g, frame.number, 0.0) for g in near):
            told["hidden", str(row["cause"]).startswith(("occluded", "between_beams"))] += 1
        elif met and not any(in_window(frame, g, ends).any() for g, ends in met.items()):
            told["outside", row["cause"] == "outside_window"] += 1
    return told


def test_what_rays_say_of_misses_is_their_cause() -> None:
    """The other way round: from the rays to the cause."""
    told = told_by_rays(*recorded(**ALONE))
    for what in ("hidden", "outside"):
        right, wrong = told[what, True], told[what, False]
        assert right > ENOUGH
        assert right >= AGREE * (right + wrong)


def every_error_is_one_of_those_that_are_counted(world: World, tables: dict[str, list[Row]]) -> None:
    rows = Counter((int(str(row["frame"])), str(row["kind"])) for row in tables["errors"])
    for frame, counts in zip(world.frames, tables["frames"], strict=True):
        found = tuple(rows[frame.number, kind] for kind in ("miss", "false", "fragment"))
        assert found == (counts["missed"], counts["fp"], counts["duplicates"])
        assert counts["missed"] == sum(truth.in_range and truth.detection is None for truth in frame.truths)
