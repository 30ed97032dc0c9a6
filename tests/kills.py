"""A campaign that is killed again and again ends with the bytes of one that was left alone.

    python -m tests.kills [--kills 100] [--terms 20] [--seed 1]

A command is begun, struck at a random moment, and begun again, until all blows are dealt; then it may
finish. Blows are shared out over scenes: a small labyrinth campaign that starts, that runs trials and stores
them, that exports a finished campaign, that compiles into an empty cache; and each other command that
writes files. A kill (SIGKILL) hits the parent alone, one worker, or the whole group; SIGTERM the parent or
the group. After each blow every exported file must be whole. At the end of each scene all files and the
store's rows must be those of a run that was left alone, and nothing else may be in the folder. Prints what
was hit; exits with 1 if anything differs.
"""

import argparse
import collections
import contextlib
import itertools
import os
import random
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from midnet_bench.campaign.store import FILE_NAME
from tests.campaign.campaign_process import children_of, environment

CAMPAIGN = """
experiment: labyrinth
grid: {robots: [1, 2]}
trials: 4
parameters: {engine: fast, intruders: 1, time_limit_s: 4, prior_map: exact}
"""
FAST = ("--engine", "fast", "--seed", "9001", "-q")
COMMANDS = {
    "detection": (
        *("detection", "--robots", "1,2", "--frames", "8", "--record", "--jobs", "2"),
        *(*FAST, "-o", "{at}"),
    ),
    "size": ("size", "map1", "--within", "4", "--robots", "1,2", "--trials", "6", *FAST, "-o", "{at}"),
    "map": ("map", "map1", "--set", "time_limit_s=6", *FAST, "-o", "{at}"),
    "render": ("render", "--frames", "8", "--frame", "8", *FAST, "-o", "{at}"),
    "export": ("export", "detection", "--robots", "2", "--frames", "20", *FAST, "-o", "{at}/drive.mcap"),
    "replay": ("replay", "{inputs}/export/drive.mcap", "--bag", "{at}/found.mcap", "-q", "-o", "{at}"),
    "report": ("report", "{at}", "-q"),
    "errors": ("errors", "{at}", "-q"),
}
"""the commands that write files, but for ``run``"""
READS_A_CAMPAIGN = ("report", "errors")
GOES_ON = ("running", "detection", "size")  # scenes in which a file of a part of the trials is another one
GROWS = {"boxes.csv"}  # files that a command adds to, frame by frame, for others to read meanwhile
TELL_TIMES = ("timing.csv", "provenance.json", "labyrinth_speed")
"""files of which no two runs have the same, by the beginnings of their names"""
MEASURED = re.compile(rb"<h3>Speed of one worker</h3>.*?(?=<h[23])|<h2>Provenance.*", re.DOTALL)
"""what of a page no two runs have the same: measured speeds, and when it was run"""
COMPILES_S = 4.0  # of the half a minute that it takes in all, from the command's beginning
MIN_COMPILING = 5  # blows that fall before the last loop has been compiled
PARENT, WORKER, GROUP = "parent", "worker", "group"
KILLED = ((signal.SIGKILL, PARENT), (signal.SIGKILL, GROUP), (signal.SIGKILL, WORKER))
TERMINATED = ((signal.SIGTERM, PARENT), (signal.SIGTERM, GROUP))
LONGEST_S = 1800.0  # that a command may take before it counts as hanging

Blow = tuple[signal.Signals, str]
Began = Callable[[Path, int], bool]
"""(folder, process id) -> whether the phase that a scene is about has begun"""


@dataclass(frozen=True)
class Scene:
    """What is struck, and when."""

    phase: str
    arguments: tuple[str, ...]  # of the command; ``{at}`` is the folder
    prepare: Callable[[Path], None]  # makes the folder in which the command begins
    began: Began
    window_s: float  # blows fall so long after ``began``
    wanted: dict[str, object]  # the :func:`contents` of a folder that nobody disturbed
    has_workers: bool = True
    same_times: bool = False  # the trials ran before, and their times are to be the same too
    cache: Path | None = None  # for machine code, unless it is the user's own


def main() -> int:
    """Exit code 0 if everything was the same."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--terms", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--scenes", help="only these, with a comma between")
    options = parser.parse_args()
    chance = random.Random(options.seed)
    hit: collections.Counter[tuple[str, Blow]] = collections.Counter()
    faults: list[str] = []
    with tempfile.TemporaryDirectory(prefix="kills-") as folder:
        scenes = list(make_scenes(Path(folder)))
        if options.scenes:
            scenes = [scene for scene in scenes if scene.phase in options.scenes.split(",")]
        try:
            for number, scene in enumerate(scenes):
                kills = len(range(number, options.kills, len(scenes)))
                terms = len(range(number, options.terms, len(scenes)))
                blows = in_an_order(kills, terms, scene.has_workers, chance)
                found = strike(scene, blows, Path(folder, scene.phase), chance, hit)
                print(
                    f"{scene.phase}: {len(blows)} blows, {len(found)} faults", *found, sep="\n  ", flush=True
                )
                faults += found
        finally:  # also of an interrupted one
            print_table(hit)
    return 1 if faults else 0


def in_an_order(kills: int, terms: int, has_workers: bool, chance: random.Random) -> list[Blow]:
    """The blows for one scene.

    A blow that ends the process follows on one that ends a worker: a trial with which two workers die has
    failed, and by right.
    """
    ways = KILLED if has_workers else KILLED[:2]
    dealt = [ways[k % len(ways)] for k in range(kills)] + [TERMINATED[k % 2] for k in range(terms)]
    at_worker = [blow for blow in dealt if blow[1] == WORKER]
    rest = [blow for blow in dealt if blow[1] != WORKER]
    chance.shuffle(rest)
    together = [[*at_worker[k : k + 1], blow] for k, blow in enumerate(rest)]
    chance.shuffle(together)
    return list(itertools.chain.from_iterable(together))


def print_table(hit: collections.Counter[tuple[str, Blow]]) -> None:
    """Phase by phase, as it was seen when the blow fell."""
    columns = (*KILLED, *TERMINATED)
    print(f"{'hit while':<14}" + "".join(f"{number.name[3:]} {target:<8}" for number, target in columns))
    for phase in dict.fromkeys(phase for phase, _ in hit):
        print(f"{phase:<14}" + "".join(f"{hit[phase, blow]:<{len(blow[1]) + 5}}" for blow in columns))
    print(f"{sum(hit.values())} blows in all")


def make_scenes(folder: Path) -> Iterator[Scene]:
    """Runs everything undisturbed once, to know what must come out and how long each phase takes."""
    (folder / "small.yaml").write_text(CAMPAIGN)
    run = ("run", str(folder / "small.yaml"), "--jobs", "2", "-q", "-o", "{at}")
    finished = folder / "finished"

    starts_s, runs_s, _ = measured(run, finished, runs, writes)
    fresh = contents(finished)
    yield Scene("starting", run, Path.mkdir, lambda at, pid: True, starts_s, fresh)

    def finished_store(at: Path) -> None:
        at.mkdir()
        shutil.copy(finished / FILE_NAME, at)

    again = folder / "again"
    finished_store(again)
    _, exports_s = measured(run, again, writes)
    exported_again = contents(again, True)
    yield Scene("exporting", run, finished_store, writes, exports_s, exported_again, False, same_times=True)

    yield Scene("running", run, Path.mkdir, runs, runs_s, fresh)
    yield from scenes_of_commands(folder / "alone")
    # last, for the end of it compiles everything
    yield Scene(
        "compiling", run, Path.mkdir, lambda at, pid: True, COMPILES_S, fresh, cache=folder / "compiled"
    )


def scenes_of_commands(alone: Path) -> Iterator[Scene]:
    """A scene of each command of :data:`COMMANDS`, struck from its first moment to its last."""
    for name, arguments in COMMANDS.items():
        arguments = tuple(argument.replace("{inputs}", str(alone)) for argument in arguments)

        def prepare(at: Path, reads: bool = name in READS_A_CAMPAIGN) -> None:
            if reads:
                shutil.copytree(alone / "detection", at)
            else:
                at.mkdir(parents=True)

        prepare(alone / name)
        (whole_s,) = measured(arguments, alone / name)
        yield Scene(
            name,
            arguments,
            prepare,
            lambda at, pid: True,
            whole_s,
            contents(alone / name),
            has_workers=name in GOES_ON,
        )


def runs(at: Path, pid: int) -> bool:
    """Whether this process has a worker, which begins its first trial at once."""
    return bool(children_of(pid))


def writes(at: Path, pid: int) -> bool:
    """Whether the process has drafts of files in the folder."""
    return any(at.glob(f".*.{pid}.new"))


def measured(arguments: tuple[str, ...], at: Path, *signs: Began) -> list[float]:
    """Runs a command to its end; the seconds to the first sign, from each to the next, and to the end."""
    with begun(arguments, at, None) as (process, said):
        moments_s = [time.perf_counter()]
        for sign in signs:
            assert wait_for(process, at, sign), said_in(said)
            moments_s.append(time.perf_counter())
        assert process.wait(LONGEST_S) == 0, said_in(said)
        moments_s.append(time.perf_counter())
    return [after - before for before, after in itertools.pairwise(moments_s)]


def strike(
    scene: Scene,
    blows: list[Blow],
    at: Path,
    chance: random.Random,
    hit: collections.Counter[tuple[str, Blow]],
) -> list[str]:
    """Deals the blows, begins again after each, and lets the last one finish; what is not as it must be."""
    faults: list[str] = []
    scene.prepare(at)
    waiting = collections.deque(blows)
    groups: list[int] = []
    loops: list[int] = []
    while waiting:
        with begun(scene.arguments, at, scene.cache) as (process, said):
            groups.append(process.pid)
            while waiting:
                phase = at_a_moment(scene, process, at, chance)
                if phase is None:
                    break
                number, target = waiting.popleft()
                workers = children_of(process.pid) if target == WORKER else []
                if not workers and target == WORKER:
                    target = PARENT
                with contextlib.suppress(ProcessLookupError):  # it has just ended
                    (os.killpg if target == GROUP else os.kill)(
                        chance.choice(workers or [process.pid]), number
                    )
                hit[phase, (number, target)] += 1
                loops += [] if scene.cache is None else [loops_in(scene.cache)]
                if target != WORKER:
                    break
            process.wait(LONGEST_S)
            complaints = said_in(said)
        if process.returncode not in (0, -signal.SIGKILL, -signal.SIGTERM, 128 + signal.SIGTERM):
            faults.append(f"exit code {process.returncode}: {complaints}")
        if "Traceback" in complaints:
            faults.append(complaints)
        faults += not_whole(scene, at)
        if process.returncode == 0:
            faults += differences(scene, at)
            if waiting:
                shutil.rmtree(at)
                scene.prepare(at)
    with begun(scene.arguments, at, scene.cache) as (process, said):
        if process.wait(LONGEST_S):
            faults.append(f"at last exit code {process.returncode}: {said_in(said)}")
    if scene.cache is not None and sum(count < loops_in(scene.cache) for count in loops) < MIN_COMPILING:
        faults.append(f"only {len(loops) - loops.count(max(loops))} blows fell while loops were compiled")
    faults += differences(scene, at)
    faults += [f"workers of {group} are still there" for group in groups if is_there(group)]
    return faults


def at_a_moment(
    scene: Scene, process: subprocess.Popen[bytes], at: Path, chance: random.Random
) -> str | None:
    """Waits for a random moment of the scene; what goes on then, None if the process ended before."""
    if not wait_for(process, at, scene.began):
        return None
    deadline_s = time.perf_counter() + chance.uniform(0.0, scene.window_s)
    while (left_s := deadline_s - time.perf_counter()) > 0:
        if process.poll() is not None:
            return None
        time.sleep(min(left_s, 0.02))
    if process.poll() is not None:
        return None
    if scene.phase in COMMANDS or scene.cache is not None:  # the latter: before its workers begin
        return scene.phase
    if runs(at, process.pid):
        return "running"
    return "starting" if scene.phase == "starting" and not writes(at, process.pid) else "exporting"


def wait_for(process: subprocess.Popen[bytes], at: Path, sign: Began) -> bool:
    """Whether the sign came before the process ended."""
    deadline_s = time.perf_counter() + LONGEST_S
    while not sign(at, process.pid):
        if process.poll() is not None:
            return False
        assert time.perf_counter() < deadline_s, "the command hangs"
        time.sleep(0.002)
    return True


@contextlib.contextmanager
def begun(
    arguments: tuple[str, ...], at: Path, cache: Path | None
) -> Iterator[tuple[subprocess.Popen[bytes], IO[bytes]]]:
    """The command on its way in a process group of its own, and the file of what it says on stderr.

    It is no pipe, so that nobody has to wait for workers that outlive their parent by a moment.
    """
    variables = {**environment(), "PYTHONWARNINGS": "default"}
    if cache is not None:
        variables["NUMBA_CACHE_DIR"] = str(cache)
    filled = [argument.replace("{at}", str(at)) for argument in arguments]
    command = [sys.executable, "-P", "-m", "midnet_bench", *filled]
    with (
        tempfile.TemporaryFile() as said,
        subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=said, env=variables, process_group=0
        ) as process,
    ):
        try:
            yield process, said
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise


def said_in(file: IO[bytes]) -> str:
    """What the command said."""
    file.seek(0)
    return file.read().decode(errors="replace")


def loops_in(cache: Path) -> int:
    """How many compiled loops are kept there."""
    return sum(1 for _ in cache.rglob("*.nbc"))


def is_there(group: int) -> bool:
    """Whether processes of a group that lost its leader are still there after a minute."""
    deadline_s = time.monotonic() + 60.0
    with contextlib.suppress(ProcessLookupError):
        while time.monotonic() < deadline_s:
            os.killpg(group, 0)
            time.sleep(0.1)
        return True
    return False


def contents(at: Path, tells_times: bool = False) -> dict[str, object]:
    """File name -> bytes, of what a command exported; what its store holds, row by row; all names."""
    found: dict[str, object] = {"names": sorted(path.name for path in at.iterdir())}
    if not (at / FILE_NAME).is_file():
        return found | exported(at, tells_times)
    rows = "*" if tells_times else "cell, seed, simulated_s, traceback, result"
    with contextlib.closing(sqlite3.connect(at / FILE_NAME)) as store:
        found |= {
            "definition": store.execute("SELECT * FROM campaign").fetchall(),
            "cells": store.execute("SELECT * FROM cells ORDER BY cell").fetchall(),
            "trials": store.execute(f"SELECT {rows} FROM trials ORDER BY cell, seed").fetchall(),
            "state": store.execute("PRAGMA integrity_check").fetchall(),
        }
    return found | exported(at, tells_times)


def exported(at: Path, tells_times: bool) -> dict[str, bytes]:
    """The files that are neither hidden nor the store."""
    return {
        path.name: path.read_bytes() if tells_times else MEASURED.sub(b"", path.read_bytes())
        for path in at.glob("[!.]*")
        if path.is_file() and not path.name.startswith(FILE_NAME)
        if tells_times or not path.name.startswith(TELL_TIMES)
    }


def not_whole(scene: Scene, at: Path) -> list[str]:
    """Of a folder whose campaign was struck: which exported files are not as they must be in the end."""
    if scene.phase in GOES_ON:
        return []
    there = exported(at, scene.same_times)
    grown = there.keys() - GROWS
    return [f"{name} is not whole" for name in sorted(grown) if there[name] != scene.wanted.get(name)]


def differences(scene: Scene, at: Path) -> list[str]:
    """What is not as in the folder that nobody disturbed."""
    found = contents(at, scene.same_times)
    return [
        f"{name} differs" + (f": {found.get(name)}" if name == "names" else "")
        for name in {**found, **scene.wanted}
        if found.get(name) != scene.wanted.get(name)
    ]


if __name__ == "__main__":
    sys.exit(main())
