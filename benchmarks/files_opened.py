"""Files of the package that a reader opens to follow a control cycle, a MIDNet frame, and a command.

Run it as ``python -m benchmarks.files_opened``. A file counts when a function of it runs, by a trace of
every Python call; ``__init__`` files do not. Compiled loops are not seen as calls: they stand beside what
calls them. ``NUMBA_DISABLE_JIT=1`` before the command shows them too, and takes minutes. What loads them from
the cache is no part of a cycle or a frame: all were called before.

The command is ``detection`` with one cell: one robot, ten frames, one seed, ``--jobs 1``, PyBullet,
``thresh_local=90``. It runs in a fresh process, of which every function of the package counts that is called
in its main thread, from the command line to the report. The trial itself runs in a worker and does not
count, nor does what draws its arena again for the pictures (``arena.layout.place``); comprehensions and
generators count as part of their function, and what runs while modules are imported does not count.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType

import midnet_bench
from midnet_bench.campaign.definition import Campaign, resolve
from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial, run_detection
from midnet_bench.simulation.fleet import SCAN_HZ
from midnet_bench.workflows.campaigns import compile_ahead

PACKAGE = Path(midnet_bench.__file__).parent
WORLD = ("simulation", "robots", "arena")  # rooms below which a real robot would have its drivers


@contextmanager
def traced(
    begin: Callable[[CodeType], bool] = lambda code: True, left_out: tuple[str, ...] = ()
) -> Iterator[set[str]]:
    """The files of the package whose functions run, from the first call that ``begin`` takes on.

    Nothing below a function whose qualified name is among ``left_out`` counts.
    """
    opened: set[str] = set()
    begun, depth = False, 0

    def profile(frame: FrameType, event: str, argument: object) -> None:
        nonlocal begun, depth
        code = frame.f_code
        if event == "call":
            begun = begun or begin(code)
            if code.co_qualname in left_out or depth:
                depth += 1
                return
            path = Path(code.co_filename)
            if begun and path.is_relative_to(PACKAGE) and path.name != "__init__.py":
                opened.add(path.relative_to(PACKAGE).as_posix())
        elif event == "return" and depth:
            depth -= 1

    sys.setprofile(profile)
    try:
        yield opened
    finally:
        sys.setprofile(None)


def control_cycle() -> set[str]:
    """Of one guard that localizes by UKF, takes a scan, plans and controls; and of the world under it."""
    parameters = DetectionParameters.of(arena="empty", robots=1, frames=1)
    with DetectionTrial(parameters, seed=1) as trial:
        guard = trial.guards[0]
        guard.drive_to(trial.next_patrol_point(guard))
        ticks = 2 * trial.step_hz // SCAN_HZ
        for _ in range(ticks):
            trial.fleet.step()
        with traced() as opened:
            for _ in range(ticks):
                trial.fleet.step()
    return opened


def midnet_frame() -> set[str]:
    """From the scans of two guards to the row of scores, without physics and driving."""
    parameters = DetectionParameters.of(robots=2, frames=10)
    driving = ("Fleet._localize", "MobileRobot.control", "Navigator.observe", "Dwell.update")
    world = ("World.step", "World.drive", "World.velocities", "ImuSensors.read")
    noted = ("HealthTracker.update", "Standstill.update")
    rest = ("DetectionTrial.__init__", "RobotTrial.rows_of_robots", "RobotTrial.__exit__")
    run_detection(parameters, seed=1)
    with traced(lambda code: code.co_name == "advance", (*driving, *world, *noted, *rest)) as opened:
        run_detection(parameters, seed=1)
    return opened


CELL = ("--engine", "bullet", "--robots", "1", "--frames", "10", "--set", "thresh_local=90")
COMMAND = ("detection", *CELL, "--seeds", "1", "--jobs", "1", "-q", "-o")
INNER = ("<lambda>", "<genexpr>", "<listcomp>", "<setcomp>", "<dictcomp>", "<module>")


def command() -> set[str]:
    """The files that a command with one cell enters."""
    program = "from benchmarks.files_opened import print_command; print_command()"
    # what compiles is no part of a command: it was compiled before
    campaign = Campaign(experiment="detection", grid={"robots": [1]}, parameters={"engine": "bullet"})
    compile_ahead(resolve(campaign, registry))
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-c", program, f"{folder}/counted"], capture_output=True, text=True, check=True
        )
    return set(json.loads(done.stdout.splitlines()[-1]))


def print_command() -> None:
    """Run the command in this process; its folder is the first argument. Prints the files as JSON."""
    from midnet_bench.cli import main as command_line

    files: set[str] = set()
    depth = 0
    prefix = f"{PACKAGE}/"

    def profile(frame: FrameType, event: str, argument: object) -> None:
        nonlocal depth
        code = frame.f_code
        if event == "return" and depth:
            depth -= 1
        if event != "call" or not code.co_filename.startswith(prefix):
            depth += bool(depth) and event == "call"
            return
        name = code.co_filename.removeprefix(prefix)
        if depth or code.co_name == "<module>" or (name, code.co_name) == ("arena/layout.py", "place"):
            depth += 1
        elif name.endswith(".py") and not name.endswith("__init__.py") and code.co_name not in INNER:
            files.add(name)

    sys.argv = ["midnet-bench", *COMMAND, sys.argv[1]]
    sys.setprofile(profile)
    try:
        command_line()
    except SystemExit as end:
        if end.code:
            raise
    finally:
        sys.setprofile(None)
    print(json.dumps(sorted(files)))


def main() -> None:
    cycle = control_cycle()
    software = {name for name in cycle if not name.startswith(WORLD)}
    for title, files in (
        ("one control cycle, the robot's own software", software),
        ("one control cycle, the simulated world under it", cycle - software),
        ("one MIDNet frame, from the scan to the row of scores", midnet_frame()),
        ("a command of one cell, outside the trial", command()),
    ):
        print(f"{title}: {len(files)} files")
        for name in sorted(files):
            print(f"  {name}")


if __name__ == "__main__":
    main()
