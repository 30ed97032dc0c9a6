"""How the time of a trial grows with the number of robots and with the area that they guard.

    python -m benchmarks.growth [--engine fast] [--seconds 10] [--robots 2 6 12 20] [--areas 1 2 4]

Half of the robots guard Map 1, half intrude, all with LiDAR, pose filter, costmaps and planners, and MIDNet
looks over the guards. The area grows by moving every corner of every wall away from the middle; walls stay
as thick as they are. A cell is wall milliseconds per simulated second, without the trial's set-up, and (in
brackets) CPU milliseconds per robot: the least of the repeats, which go round all cells.
"""

import argparse
import math
import time
from collections.abc import Sequence
from itertools import product

from midnet_bench.arena.arena import Arena, load_arena
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.workflows.campaigns import compile_kernels

FRAME_HZ = 5
SETTLING_FRAMES = 5


def grown(arena: Arena, area: float, intruders: int) -> Arena:
    """The arena with ``area`` times its area and so many mobile intruders."""
    scale = math.sqrt(area)
    return arena.model_copy(
        update={
            "plane_m": tuple(scale * side for side in arena.plane_m),
            "enclosure_m": tuple(scale * side for side in arena.enclosure_m),
            "walls": tuple(tuple((scale * x, scale * y) for x, y in line) for line in arena.walls),
            "robots": arena.robots.model_copy(
                update={"center_m": tuple(scale * place for place in arena.robots.center_m)}
            ),
            "mobile_intruders": arena.mobile_intruders.model_copy(update={"count": intruders}),
        }
    )


def measure(arena: Arena, robots: int, engine: str, seconds: float, seed: int) -> tuple[float, float]:
    """Wall and CPU milliseconds per simulated second of one trial with ``robots`` in all."""
    guards = robots - robots // 2
    parameters = DetectionParameters.of(
        arena=grown(arena, 1.0, robots // 2).model_dump_json(),
        prior_map="exact",
        robots=guards,
        frames=SETTLING_FRAMES + round(seconds * FRAME_HZ),
        engine=engine,
    )
    with DetectionTrial(parameters, seed) as trial:
        frames = trial.frames()
        for _ in range(SETTLING_FRAMES):
            next(frames)
        wall, cpu = time.perf_counter(), time.process_time()
        for _ in frames:
            pass
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return 1e3 * wall / seconds, 1e3 * cpu / seconds


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--engine", choices=("bullet", "fast"), default="bullet")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--robots", type=int, nargs="+", default=[2, 6, 12, 20])
    parser.add_argument("--areas", type=float, nargs="+", default=[1.0, 2.0, 4.0])
    options = parser.parse_args(arguments)
    compile_kernels()
    table(options.engine, options.robots, options.areas, options.seconds, options.repeats)


def table(engine: str, teams: list[int], areas: list[float], seconds: float, repeats: int) -> None:
    """Print it; every loop is compiled before."""
    arenas = {area: grown(load_arena("map1"), area, 0) for area in areas}
    least = dict.fromkeys(product(teams, areas), (math.inf, math.inf))
    for repeat in range(repeats):
        for robots, area in least:
            new = measure(arenas[area], robots, engine, seconds, 1 + repeat)
            old = least[robots, area]
            least[robots, area] = min(old[0], new[0]), min(old[1], new[1])
    print(f"engine {engine}: wall ms per simulated second (CPU ms per robot), by robots and area")
    print("robots" + "".join(f"{f'{area:g} x area':>18}" for area in areas))
    for robots in teams:
        cells = (least[robots, area] for area in areas)
        print(f"{robots:>6}" + "".join(f"{wall:>9.1f} ({cpu / robots:>5.2f})" for wall, cpu in cells))
    few, many = min(teams), max(teams)
    growth = [least[many, area][1] / many / (least[few, area][1] / few) - 1.0 for area in areas]
    print(
        f"growth per robot from {few} to {many}: " + ", ".join(f"{100.0 * share:+.0f} %" for share in growth)
    )


if __name__ == "__main__":
    main()
