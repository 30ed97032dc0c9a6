"""How fast GMapping keeps up with a Burger: milliseconds per integrated scan and the real-time ratio.

Run ``python -m benchmarks.gmapping``. A robot circles among boxes in a 20 x 20 m hall at 0.22 m/s for 120 s
and scans at 5 Hz; its odometry is exact. On one thread, and on all cores; the world's own ray casting is not
counted.
"""

import math
import time

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D
from midnet_bench.mapping.gmapping import GMapping, cores
from midnet_bench.mapping.mapping_settings import BURGER_UKF, GmappingSettings
from midnet_bench.rng import stream
from midnet_bench.robots.turtlebot3 import LDS_01

LIDAR = LDS_01
PERIOD_S, SPEED_MPS, RADIUS_M = 0.2, 0.22, 4.0


def hall() -> npt.NDArray[np.float64]:
    """(S, 4) walls: an outer square and 1 m boxes on a 2.5 m raster, but none on the robot's circle."""
    squares = [(-10.0, -10.0, 20.0)]
    for x in np.arange(-8.75, 9.0, 2.5):
        for y in np.arange(-8.75, 9.0, 2.5):
            if abs(math.hypot(x, y) - RADIUS_M) > 1.2:
                squares.append((x - 0.5, y - 0.5, 1.0))
    sides = []
    for x, y, side in squares:
        sides += [(x, y, x + side, y), (x, y + side, x + side, y + side)]
        sides += [(x, y, x, y + side), (x + side, y, x + side, y + side)]
    return np.array(sides)


def scan(walls: npt.NDArray[np.float64], pose: Pose2D) -> npt.NDArray[np.float64]:
    bearings = pose.yaw + LIDAR.angles_rad
    direction = np.column_stack([np.cos(bearings), np.sin(bearings)])
    edge, start = walls[:, 2:] - walls[:, :2], walls[:, :2] - (pose.x, pose.y)
    cross = direction[:, :1] * edge[:, 1] - direction[:, 1:] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (start[:, 0] * edge[:, 1] - start[:, 1] * edge[:, 0]) / cross
        share = (start[:, 0] * direction[:, 1:] - start[:, 1] * direction[:, :1]) / cross
    distance[~((distance > 0.0) & (share >= 0.0) & (share <= 1.0))] = np.inf
    ranges = distance.min(axis=1)
    return np.where(ranges <= LIDAR.range_max_m, ranges, np.inf)


def measure(name: str, settings: GmappingSettings, seconds: float = 120.0, threads: int = 1) -> None:
    walls = hall()
    times = PERIOD_S * np.arange(round(seconds / PERIOD_S))
    angles = times * SPEED_MPS / RADIUS_M
    poses = [Pose2D(RADIUS_M * math.cos(a), RADIUS_M * math.sin(a), a + math.pi / 2) for a in angles]
    noise = np.random.default_rng(0)
    scans = [scan(walls, pose.compose(LIDAR.mount)) + noise.normal(0.0, 0.01, LIDAR.beams) for pose in poses]
    slam = GMapping(LIDAR, settings, poses[0], stream(0, "benchmark"), threads)
    slam.process(poses[0], scans[0], float(times[0]))
    slam.process(poses[10], scans[10], float(times[10]))  # compiles the kernels, which are cached on disk
    slam = GMapping(LIDAR, settings, poses[0], stream(0, "benchmark"), threads)
    begin = time.perf_counter()
    integrated = sum(
        slam.process(pose, ranges, float(stamp))
        for pose, ranges, stamp in zip(poses, scans, times, strict=True)
    )
    taken = time.perf_counter() - begin
    begin = time.perf_counter()
    grid = slam.occupancy()
    drawn = time.perf_counter() - begin
    error = slam.best_pose.distance_to(poses[-1])
    print(
        f"{name:12} {settings.particles} particles, threads {threads}: {integrated} of {len(scans)} scans, "
        f"{1e3 * taken / integrated:.1f} ms each, {seconds / taken:.0f} times real time; "
        f"map of {grid.width} x {grid.height} cells drawn anew in {1e3 * drawn:.0f} ms; "
        f"last pose off by {error:.3f} m"
    )


def main(seconds: float = 120.0) -> None:
    for name, settings in (("TURTLEBOT3", GmappingSettings()), ("BURGER_UKF", BURGER_UKF)):
        for threads in sorted({1, cores()}):
            measure(name, settings, seconds, threads)


if __name__ == "__main__":
    main()
