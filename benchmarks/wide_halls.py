"""How well graph SLAM maps what a Burger's LiDAR of 3.5 m sees of wide halls and squares of corridors.

Run ``python -m benchmarks.wide_halls [SEED ...]``: a hall (10 to 24 m by 9 to 18 m, up to three pillars, two
laps 0.8 to 3 m off the walls) and a square of corridors (1.5 to 2.4 m wide) for each seed, 1 to 20 unless
given. The wheels err by 3 % a step of 0.1 m, 2 % of a turn, and drift by 0.2 degrees a metre. Printed: the
mean and greatest distance of the trajectory from the truth, metres, that of the wheels, and any warning.
"""

import math
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import LidarGeometry, Pose2D, lengths, wrap_angle
from midnet_bench.io.scan_logs import LoggedScan, ScanLog
from midnet_bench.mapping.log_mapping import MappingResult, map_scans
from midnet_bench.robots.turtlebot3 import LDS_01

Floats = npt.NDArray[np.float64]
STEP_M, TURN_RAD, SCAN_EVERY = 0.1, 0.2, 3
STEP_ERROR, TURN_ERROR, DRIFT_RAD, RANGE_ERROR_M = 0.03, 0.02, 0.004, 0.01


def rectangle(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float, float, float]]:
    """Its four walls, x and y of both ends."""
    return [(x0, y0, x1, y0), (x1, y0, x1, y1), (x1, y1, x0, y1), (x0, y1, x0, y0)]


def scene(kind: str, rng: np.random.Generator) -> tuple[Floats, list[tuple[float, float]]]:
    """(N, 4) walls of a ``hall`` or a ``square`` of corridors, and the corners of two laps, metres."""
    if kind == "hall":
        width, height, off = rng.uniform(10.0, 24.0), rng.uniform(9.0, 18.0), rng.uniform(0.8, 3.0)
        walls = rectangle(0.0, 0.0, width, height)
        for _ in range(rng.integers(0, 4)):
            x, y, side = rng.uniform(4.0, width - 4.0), rng.uniform(4.0, height - 4.0), rng.uniform(0.3, 0.6)
            walls += rectangle(x, y, x + side, y + side)
    else:
        width, height, corridor = rng.uniform(12.0, 24.0), rng.uniform(10.0, 20.0), rng.uniform(1.5, 2.4)
        walls = rectangle(0.0, 0.0, width, height)
        walls += rectangle(corridor, corridor, width - corridor, height - corridor)
        off = corridor / 2.0
    lap = [(off, off), (width - off, off), (width - off, height - off), (off, height - off)]
    return np.array(walls), [*lap, *lap, lap[0]]


def way(corners: Sequence[tuple[float, float]]) -> list[Pose2D]:
    """Poses from corner to corner, with turns on the spot."""
    (x, y), yaw = corners[0], 0.0
    poses = [Pose2D(x, y, yaw)]
    for (x0, y0), (x1, y1) in pairwise(corners):
        heading = math.atan2(y1 - y0, x1 - x0)
        while abs(turn := wrap_angle(heading - yaw)) > 1e-6:
            yaw = wrap_angle(yaw + max(min(turn, TURN_RAD), -TURN_RAD))
            poses.append(Pose2D(x0, y0, yaw))
        steps = max(int(math.hypot(x1 - x0, y1 - y0) / STEP_M), 1)
        shares = (np.arange(1, steps + 1) / steps).tolist()
        poses += [Pose2D(x0 + (x1 - x0) * share, y0 + (y1 - y0) * share, yaw) for share in shares]
    return poses


def ranges(pose: Pose2D, lidar: LidarGeometry, walls: Floats, rng: np.random.Generator) -> Floats:
    """(beams,) metres; 0 where nothing is within range."""
    headings = pose.yaw + lidar.angles_rad
    rays = np.stack((np.cos(headings), np.sin(headings)), axis=1)[:, None]
    to_wall, along = walls[:, :2] - np.array(pose[:2]), walls[:, 2:] - walls[:, :2]
    cross = rays[..., 0] * along[:, 1] - rays[..., 1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        found_m = (to_wall[:, 0] * along[:, 1] - to_wall[:, 1] * along[:, 0]) / cross
        share = (to_wall[:, 0] * rays[..., 1] - to_wall[:, 1] * rays[..., 0]) / cross
    found_m = np.where((found_m > lidar.range_min_m) & (share >= 0.0) & (share <= 1.0), found_m, np.inf)
    nearest_m: Floats = found_m.min(axis=1) + rng.normal(0.0, RANGE_ERROR_M, lidar.beams)
    return np.where(nearest_m > lidar.range_max_m, 0.0, nearest_m)


def drive(kind: str, seed: int, lidar: LidarGeometry) -> tuple[ScanLog, list[Pose2D]]:
    """A log, and where the robot really was at each of its scans."""
    rng = np.random.default_rng(seed)
    walls, corners = scene(kind, rng)
    poses, drift = way(corners), rng.normal(0.0, DRIFT_RAD)
    by_wheels, scans, truth = poses[0], [], []
    for number, pose in enumerate(poses):
        if number:
            x, y, turn = pose.relative_to(poses[number - 1])
            scale, way_m = 1.0 + rng.normal(0.0, STEP_ERROR), math.hypot(x, y)
            turn = turn * (1.0 + rng.normal(0.0, TURN_ERROR)) + (rng.normal(0.0, 0.03) + drift) * way_m
            by_wheels = by_wheels.compose(Pose2D(x * scale, y * scale, turn))
        if number % SCAN_EVERY == 0:
            scans.append(LoggedScan(0.2 * number, by_wheels, ranges(pose, lidar, walls, rng)))
            truth.append(pose)
    return ScanLog(Path(f"{kind}-{seed}.log"), lidar, scans), truth


def errors_m(result: MappingResult, truth: Sequence[Pose2D]) -> Floats:
    """(poses,) distances of the trajectory from the truth."""
    true = np.array([truth[number - 1][:2] for number in result.integrated])
    return lengths(result.trajectory.poses[:, :2] - true)


def main(*seeds: str) -> None:
    good = runs = 0
    for kind in ("hall", "square"):
        for seed in map(int, seeds or map(str, range(1, 21))):
            log, truth = drive(kind, seed, LDS_01)
            result = map_scans(log)
            off_m = errors_m(result, truth)
            wheels_m = lengths(np.array([a.odometry[:2] for a in log]) - np.array([b[:2] for b in truth]))
            warned = len(result.warnings) > len(log.warnings)
            runs, good = runs + 1, good + (off_m.mean() <= 0.3 or warned)
            print(
                f"{kind} {seed}: {off_m.mean():.2f} m, at most {off_m.max():.2f} m, "
                f"wheels {wheels_m.mean():.2f} m{', warned' if warned else ''}",
                flush=True,
            )
    print(f"{good} of {runs} within 0.3 m or warned")


if __name__ == "__main__":
    main(*sys.argv[1:])
