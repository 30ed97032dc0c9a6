"""Milliseconds of one core that each engine takes per simulated second, with 2, 6 and 10 Burgers that scan.

Run it as ``python -m benchmarks.physics [ARENA]`` (default: map2). Scans are whole, noise included.
"""

import sys
import time

import numpy as np

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.messages import Command
from midnet_bench.rng import stream
from midnet_bench.robots.burger import BURGER
from midnet_bench.simulation.engines import make_world
from midnet_bench.simulation.lidar import LidarSensors
from midnet_bench.simulation.settings import WorldSettings

SIMULATED_S = 30
SCAN_HZ, CONTROL_HZ = 5, 10


def measure(
    engine: str, arena: str, robots: int, intruders: int, simulated_s: int
) -> tuple[float, float, float]:
    """Start-up in milliseconds, then steps and scans in milliseconds per simulated second."""
    count = robots + intruders
    steering = stream(1, "steering")
    begin = time.perf_counter()
    world = make_world(place(load_arena(arena), 1, robots, intruders), WorldSettings(engine=engine), BURGER)
    start_s = time.perf_counter() - begin
    lidars = LidarSensors(world)
    noise = lidars.noise([stream(1, "lidar", number) for number in range(count)])
    step_s = scans_s = 0.0
    for tick in range(simulated_s * world.step_hz):
        if tick % (world.step_hz // CONTROL_HZ) == 0:
            for number in np.flatnonzero(steering.random(count) < 0.1).tolist():
                linear, angular = steering.uniform((0.0, -1.5), (0.22, 1.5)).tolist()
                world.drive(number, Command(linear, angular))
        scanning = [n for n in range(count) if (tick - n) % (world.step_hz // SCAN_HZ) == 0]
        before = time.perf_counter()
        world.step()
        between = time.perf_counter()
        if scanning:
            lidars.scan(scanning, noise)
        step_s += between - before
        scans_s += time.perf_counter() - between
    world.close()
    return start_s * 1e3, step_s * 1e3 / simulated_s, scans_s * 1e3 / simulated_s


def main(arena: str = "map2", simulated_s: int = SIMULATED_S) -> None:
    engines = ("bullet", "fast")
    for engine in engines:  # compiles and loads what is used for the first time
        measure(engine, arena, 1, 1, 1)
    print(f"arena {arena}, ms per simulated second; 5 scans of 360 beams a second and robot")
    print(f"{'engine':>8} {'robots':>6} {'start ms':>9} {'steps':>7} {'scans':>7} {'both':>7} {'ratio':>6}")
    for robots in (1, 3, 5):
        both_of = {}
        for engine in engines:
            runs = [measure(engine, arena, robots, robots, simulated_s) for _ in range(3)]
            start, step, scans = min(runs, key=lambda run: run[1] + run[2])
            both_of[engine] = step + scans
            ratio = both_of[engine] / both_of["bullet"]
            print(
                f"{engine:>8} {2 * robots:>6} {start:>9.1f} {step:>7.2f} {scans:>7.2f}"
                f" {step + scans:>7.2f} {ratio:>6.2f}"
            )


if __name__ == "__main__":
    main(*sys.argv[1:2])
