"""How many times the CPU time of a fixed commit, and of bare PyBullet, does a trial of this tree take?

    python -m benchmarks.standing
    python -m benchmarks.standing --seeds 2 --cases 5+5 --engines fast --write

Two questions, with the answers of one run of each:

* This tree against ``FIXED``, an older commit of this repository that is checked out in a temporary folder.
  Both run with the interpreter and libraries that run this, in a process each, with the settings that both
  know the same (``SAME``). Cases and seeds interleaved: see :mod:`benchmarks.compare`.
* Labyrinth trials of this tree, five guards and five intruders, against bare PyBullet: the same robots on
  their wheels, which are given the commands of those very trials at the same ticks, and the same beams at the
  same instants by ``rayTestBatch``, whose answers are read and not used. Once with as many steps a second as
  a trial has, once with 60. Intruders drive on when they are caught, so that ten robots drive to the end.

``--write`` puts what is printed into ``benchmarks/results/standing.md``.
"""

import argparse
import io
import math
import platform
import statistics
import subprocess
import tarfile
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.compare import CASES, WARM_UP_S, Case, Side, pairs, per_simulated_s
from midnet_bench.geometry import Command, Floats
from midnet_bench.simulation.engine import Beams
from midnet_bench.simulation.world import World
from midnet_bench.simulation.world_settings import WorldSettings

FIXED = "29b14cb"
"""the commit that all ratios are to; a tag would not travel with every clone"""
SAME: dict[str, Any] = {
    "intruder_speed_mps": 0.18,
    "dwa_max_vel_x_mps": 0.18,
    "local_size_m": 3.5,
    "raytrace_range_m": 3.5,
    "local_map": "persistent",
    "ally_diameter_m": 0.225,
    "iou_ally": 0.03,
}
"""defaults of this tree that ``FIXED`` has others for, given to both"""
ONLY_FIXED: dict[str, Any] = {"nav_local_size_m": 3.5}
"""a constant of this tree that ``FIXED`` has an option for"""
ENGINES = ("fast", "bullet")
STANDING = ("detection 1", "detection 5", "1+1", "3+3", "5+5")
ALL_CASES = {**CASES, "detection 1": Case("detection", 1, None), "detection 5": CASES["detection"]}
ROOT = Path(__file__).parents[1]
RESULTS = Path(__file__).parent / "results" / "standing.md"


def check_out(commit: str, folder: Path) -> Path:
    """The tree of ``commit`` in ``folder``. Raises SystemExit: this is no clone that has it."""
    try:
        packed = subprocess.run(
            ["git", "-C", str(ROOT), "archive", commit], capture_output=True, check=True
        ).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        said = getattr(error, "stderr", b"").decode(errors="replace").strip() or str(error)
        raise SystemExit(
            f"commit {commit} is needed, of a full clone: git fetch --unshallow ({said})"
        ) from None
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        archive.extractall(folder, filter="data")
    return folder


def against_fixed(
    say: Callable[[str], None],
    names: Sequence[str],
    engines: Sequence[str],
    seeds: Sequence[int],
    seconds: float,
) -> None:
    """Print a table of this tree against ``FIXED``, and the geometric mean of each engine."""
    say(f"## This tree against {FIXED}")
    say("")
    say(f"ms of CPU per simulated second; {len(seeds)} seeds of {seconds:g} s, set-up included.")
    say("")
    say(f"| engine | case | {FIXED} | this tree | ratio | of single seeds |")
    say("| --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        fixed = check_out(FIXED, Path(folder))
        for engine in engines:
            ratios = []
            settings = {"engine": engine, **SAME}
            with Side(fixed, {**settings, **ONLY_FIXED}) as old, Side(ROOT, settings) as new:
                for name in names:
                    timed = pairs(old, new, ALL_CASES[name], seconds, seeds)
                    before, now = (per_simulated_s([pair[side] for pair in timed]) for side in (0, 1))
                    each = [per_simulated_s([b]) / per_simulated_s([a]) for a, b in timed]
                    ratios.append(now / before)
                    say(
                        f"| {engine} | {name} | {1e3 * before:.1f} | {1e3 * now:.1f} | {now / before:.3f} "
                        f"| {min(each):.2f} to {max(each):.2f} |"
                    )
            mean = math.exp(statistics.fmean(map(math.log, ratios)))
            say(f"| {engine} | geometric mean | | | **{mean:.3f}** | |")
    say("")


class Recording(NamedTuple):
    """What a trial's engine was told and asked, by ticks of ``step_hz``."""

    world: World  # closed
    commands: list[tuple[int, int, list[float]]]  # tick, robot, speeds of its rims, left and right, m/s
    beams: list[tuple[int, Floats, Floats]]  # tick, (rays, 3) where they start and end, metres
    ticks: int


def recorded(parameters: dict[str, Any], seed: int) -> Recording:
    """What happens in a trial on ``fast``."""
    from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
    from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial

    with LabyrinthTrial(LabyrinthParameters.of(engine="fast", **parameters), seed) as trial:
        world, commands, beams = trial.world, [], []
        drive, cast, robot = world.engine.drive, world.engine.cast, world.robot

        def noting_drive(index: int, command: Command) -> None:
            commands.append((world.tick, index, list(robot.rim_speeds(command))))
            drive(index, command)

        def noting_cast(given: Beams, near_m: float, far_m: float) -> Floats:
            ends = np.full((2, *given.directions.shape[:2], 3), robot.lidar_height_m)
            for reach_m, points in zip((near_m, far_m), ends, strict=True):
                points[..., :2] = given.axes[:, None] + reach_m * given.directions
            beams.append((world.tick, *ends.reshape(2, -1, 3)))
            return cast(given, near_m, far_m)

        world.engine.drive, world.engine.cast = noting_drive, noting_cast  # type: ignore[method-assign]
        for _ in trial.frames():
            pass
        return Recording(world, commands, beams, world.tick)


def bare_cpu_s(recording: Recording, step_hz: int) -> float:
    """CPU seconds of PyBullet alone for the same robots, commands and beams, with so many steps a second."""
    from midnet_bench.simulation import bullet_engine

    world, per_tick = recording.world, step_hz // recording.world.step_hz
    commands, beams = iter([*recording.commands, (-1, 0, [])]), iter([*recording.beams, (-1, None, None)])
    begin = time.process_time()
    engine = bullet_engine.BulletEngine(world.layout, world.robot, step_hz)
    client, rays, bodies = engine.client, engine._ray_client, engine._bodies
    tick, number, rims = next(commands)
    cast_at, starts, ends = next(beams)
    for now in range(recording.ticks):
        while tick == now:
            client.setJointMotorControlArray(
                bodies[number].body,
                bodies[number].wheels,
                bullet_engine.bullet.VELOCITY_CONTROL,
                targetVelocities=[speed / world.robot.wheel_radius_m for speed in rims],
                forces=(world.robot.wheel_torque_nm,) * 2,
            )
            tick, number, rims = next(commands)
        for _ in range(per_tick):
            client.stepSimulation()
        while cast_at == now + 1:
            for first in range(0, len(starts), bullet_engine.BATCH):
                batch = slice(first, first + bullet_engine.BATCH)
                [hit[2] for hit in rays.rayTestBatch(starts[batch], ends[batch], numThreads=1)]
            cast_at, starts, ends = next(beams)
    engine.close()
    return time.process_time() - begin


DRIVING_ON = {"robots": 5, "intruders": 5, "after_capture": "drives_on", "ends": "time_limit"}


def against_bare(
    say: Callable[[str], None], engines: Sequence[str], seeds: Sequence[int], seconds: float
) -> None:
    """Print whole trials beside bare PyBullet on the same commands and beams."""
    parameters = {**DRIVING_ON, "time_limit_s": seconds}
    case = Case("labyrinth", 5, 5)
    ours: dict[str, list[float]] = {engine: [] for engine in engines}
    step_hz = WorldSettings().step_hz
    bare: dict[int, list[float]] = {step_hz: [], 60: []}
    with ExitStack() as stack:
        sides = {
            engine: stack.enter_context(Side(ROOT, {**DRIVING_ON, "engine": engine})) for engine in engines
        }
        for side in sides.values():
            side.run(case, WARM_UP_S, seeds[0])
        for seed in seeds:
            recording = recorded(parameters, seed)
            for engine, side in sides.items():
                ours[engine].append(side.run(case, seconds, seed).cpu_s)
            for rate, times_s in bare.items():
                times_s.append(bare_cpu_s(recording, rate))
    say("## Whole trials against bare PyBullet")
    say("")
    say(f"Map 2, five guards and five intruders that drive on, {len(seeds)} seeds of {seconds:g} s. A ratio")
    say("above 1 says that the whole trial is faster than PyBullet alone on its wheels.")
    say("")
    say(f"| | simulated s per CPU s | to bare at {step_hz} Hz | to bare at 60 Hz |")
    say("| --- | --- | --- | --- |")
    total_s = seconds * len(seeds)
    for rate, times_s in bare.items():
        say(f"| bare PyBullet, {rate} Hz | {total_s / sum(times_s):.1f} | | |")
    for engine, times_s in ours.items():
        to_bare = " | ".join(f"**{sum(others) / sum(times_s):.2f}**" for others in bare.values())
        say(f"| whole trial, `{engine}` | {total_s / sum(times_s):.1f} | {to_bare} |")
    say("")


def processor() -> str:
    """The processor's name, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.standing",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seeds", type=int, default=5, help="how many, from 1 on")
    parser.add_argument("--seconds", type=float, default=30.0, help="simulated, of each trial")
    parser.add_argument("--cases", nargs="+", choices=STANDING, default=list(STANDING))
    parser.add_argument("--engines", nargs="+", choices=ENGINES, default=list(ENGINES))
    parser.add_argument("--skip", choices=("fixed", "bare"), help="one of both questions")
    parser.add_argument("--write", action="store_true", help=f"into {RESULTS.relative_to(ROOT)}")
    given = parser.parse_args(arguments)
    seeds = range(1, given.seeds + 1)
    lines: list[str] = []

    def say(line: str) -> None:
        lines.append(line)
        print(line, flush=True)

    say("# How fast a trial is")
    say("")
    say("`python -m benchmarks.standing --write` makes this page. All figures are CPU time of one thread.")
    say("")
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numba", "numpy", "pybullet"))
    say(f"{time.strftime('%Y-%m-%d', time.gmtime())}, {processor()}, Python {platform.python_version()},")
    say(f"{libraries}, tree {commit()}.")
    say("")
    if given.skip != "fixed":
        against_fixed(say, given.cases, given.engines, seeds, given.seconds)
    if given.skip != "bare":
        against_bare(say, given.engines, seeds, given.seconds)
    if given.write:
        RESULTS.parent.mkdir(exist_ok=True)
        RESULTS.write_text("\n".join(lines).strip() + "\n", encoding="utf-8")


def commit() -> str:
    """The commit of this tree, with a plus where files differ from it."""
    run = subprocess.run(
        ["git", "-C", str(ROOT), "describe", "--always", "--dirty=+", "--abbrev=7"],
        capture_output=True,
        text=True,
    )
    return run.stdout.strip() or "without git"


if __name__ == "__main__":
    main()
