"""Microseconds of one core that each step of a robot's navigation takes, medians over many.

Run it as ``python benchmarks/navigation.py``.
"""

import time
from collections.abc import Callable

import numpy as np

from midnet_bench.geometry import Command, Pose2D
from midnet_bench.grid import OccupancyGrid
from midnet_bench.navigation.costmap import GlobalCostmap, RollingCostmap
from midnet_bench.navigation.global_planner import potential_to
from midnet_bench.navigation.navigation_settings import BURGER_COSTMAP, CostmapSettings, NavigatorSettings
from midnet_bench.navigation.navigator import Navigator, compile_kernels
from midnet_bench.robots.turtlebot3 import LDS_01

LIDAR = LDS_01
ROOM_M = 6.0


def median_us(step: Callable[[int], object], repeats: int) -> float:
    """The median time of ``step(i)``, microseconds."""
    times = np.empty(repeats)
    for i in range(repeats):
        begin = time.perf_counter()
        step(i)
        times[i] = time.perf_counter() - begin
    return float(np.median(times)) * 1e6


def comb(cells: int) -> OccupancyGrid:
    """Walls 2 m apart with doorways of 1.2 m at alternating ends, so that a way across the map is long."""
    data = np.zeros((cells, cells), dtype=np.int8)
    data[[0, -1]] = data[:, [0, -1]] = 100
    for k, row in enumerate(range(40, cells - 20, 40)):
        data[row] = 100
        data[row, 4:28] = 0 if k % 2 else data[row, 4:28]
        data[row, -28:-4] = data[row, -28:-4] if k % 2 else 0
    return OccupancyGrid(data, 0.05, (0.0, 0.0))


def scans(poses: list[Pose2D]) -> list[np.ndarray]:
    """What a LiDAR with 1 cm of noise sees in a square room of ``ROOM_M`` around the origin."""
    noise = np.random.default_rng(0)
    seen = []
    for pose in poses:
        sensor = pose.compose(LIDAR.mount)
        angles = LIDAR.angles_rad + sensor.yaw
        with np.errstate(divide="ignore", invalid="ignore"):
            to_x = (np.sign(np.cos(angles)) * ROOM_M / 2 - sensor.x) / np.cos(angles)
            to_y = (np.sign(np.sin(angles)) * ROOM_M / 2 - sensor.y) / np.sin(angles)
        ranges = np.minimum(to_x, to_y) + noise.normal(0.0, 0.01, LIDAR.beams)
        seen.append(np.where(ranges < LIDAR.range_max_m, ranges, np.inf))
    return seen


def main() -> None:
    compile_kernels()
    poses = [Pose2D(0.02 * i, -0.011 * i, 0.02 * i) for i in range(100)]
    seen = scans(poses)

    for name, settings in (("100 x 100", CostmapSettings()), ("60 x 60", BURGER_COSTMAP)):
        costmap = RollingCostmap(settings, (-4.0, -4.0))

        def take(i: int, costmap: RollingCostmap = costmap) -> None:
            costmap.update(poses[i], seen[i], LIDAR, 0.2 * i)
            costmap.published()

        print(f"{median_us(take, 100):8.0f}  scan into a rolling costmap of {name}, inflated and published")

    for cells in (160, 480):
        whole = GlobalCostmap(BURGER_COSTMAP, comb(cells))
        costs = OccupancyGrid(whole.costs, 0.05, (0.0, 0.0))
        far = (cells * 0.05 - 1.0, cells * 0.05 - 1.0)
        wave = median_us(lambda i, c=costs: potential_to((1.0, 1.0), c), 15)
        potential = potential_to((1.0, 1.0), costs)
        assert potential is not None
        print(f"{wave:8.0f}  potential on {cells} x {cells}")
        print(f"{median_us(lambda i, p=potential, f=far: p.path_from(*f), 30):8.0f}  whole path down it")
        near = median_us(lambda i, p=potential, f=far: p.path_from(*f, 1.5), 30)
        print(f"{near:8.0f}  path to the window's edge")

    empty = OccupancyGrid(np.zeros((160, 160), dtype=np.int8), 0.05, (-4.0, -4.0))
    for name, navigating in (
        ("DWA", NavigatorSettings()),
        ("Trajectory Rollout", NavigatorSettings(controller="trajectory_rollout")),
    ):
        navigator = Navigator(empty, navigating)
        navigator.set_goal(2.5, -1.5)

        def observe(i: int, navigator: Navigator = navigator) -> None:
            navigator.observe(poses[i], seen[i], LIDAR, 0.2 * i)

        def control(i: int, navigator: Navigator = navigator) -> None:
            navigator.control(poses[i], Command(0.2, 0.1), 0.2 * i)

        observed, first, second = np.empty(90), np.empty(90), np.empty(90)
        for i in range(90):
            observed[i] = median_us(lambda _, i=i: observe(i), 1)
            first[i] = median_us(lambda _, i=i: control(i), 1)
            second[i] = median_us(lambda _, i=i: control(i), 1)
        print(f"{np.median(observed):8.0f}  scan into both costmaps of a navigator")
        print(f"{np.median(first):8.0f}  control cycle after a scan, {name}")
        print(f"{np.median(second):8.0f}  control cycle between scans, {name}")


if __name__ == "__main__":
    main()
