"""Milliseconds of one core that each engine takes per simulated second, with 2, 6 and 10 Burgers that scan.

Run it as ``python -m benchmarks.physics [ARENA]`` (default: map2). Scans are whole, noise included. The
second table is CPU time of people that wander, on 4 m2 each: their steps, and the planning of their paths.
"""

import sys
import time

import numpy as np

from benchmarks.growth import grown
from midnet_bench.arena.arena import OtherIntruders, load_arena
from midnet_bench.arena.layout import place
from midnet_bench.geometry import Command
from midnet_bench.rng import stream
from midnet_bench.simulation.crowd import Crowd
from midnet_bench.simulation.sensors import LidarSensors
from midnet_bench.simulation.world import World
from midnet_bench.simulation.world_settings import WorldSettings

SIMULATED_S = 30
SCAN_HZ, CONTROL_HZ, STEP_HZ = 5, 10, 30
MAP1_M2 = 36.0


def measure(
    engine: str, arena: str, robots: int, intruders: int, simulated_s: int
) -> tuple[float, float, float]:
    """Start-up in milliseconds, then steps and scans in milliseconds per simulated second."""
    count = robots + intruders
    steering = stream(1, "steering")
    begin = time.perf_counter()
    world = World(place(load_arena(arena), 1, robots, intruders), WorldSettings(engine=engine))
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


def measure_people(people: int, simulated_s: int) -> tuple[float, float]:
    """Steps and plans, CPU milliseconds per simulated second."""
    group = OtherIntruders(kind="person", count=people)
    arena = grown(load_arena("empty"), 4.0 * people / MAP1_M2, 0)
    crowd = Crowd(place(arena.model_copy(update={"other_intruders": (group,)}), 1, 1), 1.0 / STEP_HZ)
    goals = stream(1, "goals")
    step_s = plan_s = 0.0
    for _ in range(simulated_s * STEP_HZ):
        before = time.process_time()
        for member in crowd.members:
            if member.goal is None:
                member.go_to(member.free.draw(goals))
        between = time.process_time()
        crowd.step(np.empty((0, 3)))
        crowd.solids()
        plan_s += between - before
        step_s += time.process_time() - between
    return step_s * 1e3 / simulated_s, plan_s * 1e3 / simulated_s


def main(arena: str = "map2", simulated_s: int = SIMULATED_S, repeats: int = 3) -> None:
    engines = ("bullet", "fast")
    for engine in engines:  # compiles and loads what is used for the first time
        measure(engine, arena, 1, 1, 1)
    print(f"arena {arena}, ms per simulated second; 5 scans of 360 beams a second and robot")
    print(f"{'engine':>8} {'robots':>6} {'start ms':>9} {'steps':>7} {'scans':>7} {'both':>7} {'ratio':>6}")
    for robots in (1, 3, 5):
        both_of = {}
        for engine in engines:
            runs = [measure(engine, arena, robots, robots, simulated_s) for _ in range(repeats)]
            start, step, scans = min(runs, key=lambda run: run[1] + run[2])
            both_of[engine] = step + scans
            ratio = both_of[engine] / both_of["bullet"]
            print(
                f"{engine:>8} {2 * robots:>6} {start:>9.1f} {step:>7.2f} {scans:>7.2f}"
                f" {step + scans:>7.2f} {ratio:>6.2f}"
            )
    measure_people(10, 1)
    print(f"{'people':>8} {'steps':>7} {'plans':>7}")
    for people in (10, 50, 100):
        step, plan = min(measure_people(people, simulated_s) for _ in range(repeats))
        print(f"{people:>8} {step:>7.2f} {plan:>7.2f}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
