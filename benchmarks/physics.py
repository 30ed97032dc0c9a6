"""Milliseconds of one core that PyBullet takes per simulated second, for 2, 6 and 10 Burgers that all scan.

Run it as ``python benchmarks/physics.py [ARENA]`` (default: map2).
"""

import sys
import time

import numpy as np

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.layout import place
from midnet_bench.messages import Command
from midnet_bench.rng import stream
from midnet_bench.simulation.bullet.world import World

SIMULATED_S = 30
LIDAR_TICKS, CONTROL_TICKS = 12, 6


def measure(arena: str, robots: int, intruders: int) -> tuple[float, float, float]:
    """Start-up in milliseconds, then step and rays in milliseconds per simulated second."""
    count = robots + intruders
    noise = [stream(1, "lidar", number) for number in range(count)]
    steering = stream(1, "steering")
    begin = time.perf_counter()
    with World(place(load_arena(arena), 1, robots, intruders)) as world:
        start_s = time.perf_counter() - begin
        step_s = rays_s = 0.0
        for tick in range(SIMULATED_S * world.settings.step_hz):
            if tick % CONTROL_TICKS == 0:
                for number in np.flatnonzero(steering.random(count) < 0.1).tolist():
                    linear, angular = steering.uniform((0.0, -1.5), (0.22, 1.5)).tolist()
                    world.drive(number, Command(linear, angular))
            scanning = [number for number in range(count) if (tick - number) % LIDAR_TICKS == 0]
            before = time.perf_counter()
            world.step()
            between = time.perf_counter()
            if scanning:
                world.scan(scanning, [noise[number] for number in scanning])
            after = time.perf_counter()
            step_s += between - before
            rays_s += after - between
    return start_s * 1e3, step_s * 1e3 / SIMULATED_S, rays_s * 1e3 / SIMULATED_S


def main() -> None:
    arena = sys.argv[1] if len(sys.argv) > 1 else "map2"
    print(f"arena {arena}, ms per simulated second (60 steps and 5 scans of 360 beams per robot)")
    print(f"{'robots':>6} {'start ms':>9} {'step':>7} {'rays':>7} {'both':>7}")
    for robots in (1, 3, 5):
        start, step, rays = min((measure(arena, robots, robots) for _ in range(3)), key=sum)
        print(f"{2 * robots:>6} {start:>9.0f} {step:>7.1f} {rays:>7.1f} {step + rays:>7.1f}")


if __name__ == "__main__":
    main()
