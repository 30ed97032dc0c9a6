"""Where the time of one 5-robot detection trial goes: PyBullet's step, its rays, everything else.

Run ``python -m benchmarks.trial``. Shares of one run are what counts; the milliseconds are this machine's.
"""

import time
from collections.abc import Callable
from typing import Any

from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.warm_up import compile_kernels
from midnet_bench.simulation.bullet import rays as caster
from midnet_bench.simulation.bullet.engine import bullet

FRAMES = 500
ROBOTS = 5


class Stopwatch:
    """Stands in for a function and adds up the time it takes."""

    def __init__(self, timed: Callable[..., Any]) -> None:
        self._timed = timed
        self.seconds = 0.0

    def __call__(self, *arguments: Any, **options: Any) -> Any:
        """What the function gives."""
        begin = time.perf_counter()
        try:
            return self._timed(*arguments, **options)
        finally:
            self.seconds += time.perf_counter() - begin


def main() -> None:
    compile_kernels()
    step, call, rays = (
        Stopwatch(timed) for timed in (bullet.stepSimulation, bullet.rayTestBatch, caster.ray_fractions)
    )
    bullet.stepSimulation, bullet.rayTestBatch, caster.ray_fractions = step, call, rays  # type: ignore[assignment]
    with DetectionTrial(DetectionParameters.of(robots=ROBOTS, frames=FRAMES), seed=1) as trial:
        midnet = trial.detector.midnet
        look = midnet.update = Stopwatch(midnet.update)  # type: ignore[method-assign]
        next(frames := trial.frames())  # what is loaded and compiled on first use
        step.seconds = call.seconds = rays.seconds = look.seconds = 0.0
        begin = time.perf_counter()
        for _ in frames:
            pass
        all_s = time.perf_counter() - begin
    simulated_s = (FRAMES - 1) / 5.0
    other_s = all_s - step.seconds - rays.seconds
    print(f"one detection trial, {ROBOTS} guards and 5 mobile intruders, {simulated_s:.0f} simulated s")
    for name, seconds in (("PyBullet's step", step.seconds), ("its rays", rays.seconds), ("else", other_s)):
        print(f"  {name:<16} {1000 * seconds / simulated_s:6.1f} ms/s  {100 * seconds / all_s:5.1f} %")
    print(f"  everything else / (step + rays): {other_s / (step.seconds + rays.seconds):.2f}")
    bare = all_s / (step.seconds + call.seconds) - 1.0
    print(f"  with the bare call for the rays, its answer neither read nor given back: {bare:.2f}")
    print(f"  MIDNet, Eq. 1 to fusion, five robots: {1000 * look.seconds / (FRAMES - 1):.3f} ms a frame")
    print(f"  simulated s per s: {simulated_s / all_s:.1f}")


if __name__ == "__main__":
    main()
