"""A whole detection trial against bare PyBullet, in one process: how many times its CPU time do we take?

Run ``python -m benchmarks.trial [SIMULATED_S]``, 60 unless given. Bare PyBullet is what a trial could not do
with less on the engine ``bullet``: the same robots on their wheels at the same rate, and a plain
``rayTestBatch`` of 360 rays for each LiDAR at 5 Hz, whose answer nobody reads. A trial is timed from its
parameters to its tables, once for each engine. The runs alternate; each figure is the median.
"""

import statistics
import sys
import time

import numpy as np

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import run_detection
from midnet_bench.experiments.guarded.parameters import FRAME_HZ
from midnet_bench.geometry import Command, Pose2D
from midnet_bench.rng import stream
from midnet_bench.robots.turtlebot3 import BURGER, LDS_01
from midnet_bench.simulation.world import World

GUARDS = 5
REPEATS = 3
SCAN_HZ, CONTROL_HZ = 5, 10


def main(simulated_s: float = 60.0, repeats: int = REPEATS) -> None:
    engines = ("bullet", "fast")
    for engine in engines:  # compiles and loads what is used for the first time
        trial_cpu_s(engine, 1.0)
    bare, whole = [], {engine: [] for engine in engines}
    for _ in range(repeats):
        bare.append(bare_cpu_s(simulated_s))
        for engine in engines:
            whole[engine].append(trial_cpu_s(engine, simulated_s))
    bare_s = statistics.median(bare)
    print(
        f"one detection trial, {GUARDS} guards and 5 mobile intruders, {simulated_s:g} simulated s; CPU time"
    )
    print(f"  {'bare PyBullet':<22} {bare_s:7.3f} s  {simulated_s / bare_s:6.1f} simulated s per s")
    for engine, times in whole.items():
        ratios = [time_s / other_s for time_s, other_s in zip(times, bare, strict=True)]
        median_s, spread = statistics.median(times), f"{min(ratios):.2f} to {max(ratios):.2f}"
        print(
            f"  {'whole trial, ' + engine:<22} {median_s:7.3f} s  {simulated_s / median_s:6.1f} simulated s"
            f" per s; {statistics.median(ratios):.2f} times bare PyBullet ({spread})"
        )


def trial_cpu_s(engine: str, simulated_s: float) -> float:
    begin = time.process_time()
    frames = max(1, round(simulated_s * FRAME_HZ))
    run_detection(DetectionParameters.of(robots=GUARDS, frames=frames, engine=engine), seed=1)
    return time.process_time() - begin


def bare_cpu_s(simulated_s: float) -> float:
    layout = place(load_arena("map1"), 1, GUARDS)
    steering = stream(1, "steering")
    begin = time.process_time()
    with World(layout) as world:
        robots = layout.robots + layout.intruders
        scans = [rays_of(pose) for pose in robots]
        for tick in range(round(simulated_s * world.step_hz)):
            if tick % (world.step_hz // CONTROL_HZ) == 0:
                number = int(steering.integers(len(robots)))
                world.drive(number, Command(*steering.uniform((0.0, -1.5), (0.22, 1.5)).tolist()))
            world.step()
            if tick % (world.step_hz // SCAN_HZ) == 0:
                for starts, ends in scans:
                    world.engine.client.rayTestBatch(starts, ends, numThreads=1)
    return time.process_time() - begin


def rays_of(pose: Pose2D) -> tuple[np.ndarray, np.ndarray]:
    """(360, 3) starts and ends of a Burger's rays there, metres."""
    sensor = pose.compose(LDS_01.mount)
    bearings = sensor.yaw + LDS_01.angles_rad
    directions = np.stack((np.cos(bearings), np.sin(bearings), np.zeros(LDS_01.beams)), axis=1)
    axis = np.array([sensor.x, sensor.y, BURGER.lidar_height_m])
    return axis + LDS_01.range_min_m * directions, axis + LDS_01.range_max_m * directions


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0)
