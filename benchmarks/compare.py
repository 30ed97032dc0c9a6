"""Whole trials of two checkouts, interleaved: how many times the CPU time of OLD does NEW take?

    python -m benchmarks.compare OLD NEW
    python -m benchmarks.compare ../before . --cases 5+5 detection --new-set engine=fast --repeats 6

OLD and NEW are folders with a checkout each. Both run with the interpreter that runs this, each in a process
of its own with its checkout first on PYTHONPATH, with one thread for every library, as a campaign's worker.

A trial is timed from its parameters to its tables, with its set-up, in a process that has imported everything
and loaded its compiled loops: a short trial of the same case goes before. What start-up and that first trial
cost is told apart. Trials alternate, OLD NEW NEW OLD, one seed per repeat, so that a machine that changes its
speed does it to both. CPU time is that of the whole process, all threads, user and system.

Each case simulates ``--seconds`` at most. A labyrinth trial ends earlier when nobody is left, and the two
sides may not agree on when; so the ratio is that of CPU seconds per simulated second. It is told as median
and range over the repeats, and as all of NEW by all of OLD. Cases: guards+intruders in the labyrinth (1+1,
3+1, 3+3, 5+1, 5+5), and ``detection`` with five guards.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

FRAME_HZ = 5
WARM_UP_S = 2.0
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")


class Case(NamedTuple):
    """A trial to be timed."""

    experiment: str
    guards: int
    intruders: int | None

    def parameters(self, seconds: float, more: dict[str, Any]) -> dict[str, Any]:
        """As flat keys, for ``seconds`` of simulated time."""
        if self.intruders is None:
            return {"robots": self.guards, "frames": max(1, round(seconds * FRAME_HZ)), **more}
        limit = {"time_limit_s": seconds}
        return {"robots": self.guards, "intruders": self.intruders, **limit, **more}


CASES = {
    **{f"{q}+{k}": Case("labyrinth", q, k) for q, k in ((1, 1), (3, 1), (3, 3), (5, 1), (5, 5))},
    "detection": Case("detection", 5, None),
}


class Timed(NamedTuple):
    """What one trial took."""

    cpu_s: float
    simulated_s: float
    cpu_before_s: float
    """of the process until the trial began; of the first one: of imports and of reading the parameters"""
    peak_mb: float  # of the process so far


class Side:
    """One checkout, in a process that runs its trials. A context manager."""

    def __init__(self, checkout: Path, more: dict[str, Any]) -> None:
        self.checkout, self.more = checkout.resolve(), more
        environment = {**os.environ, **dict.fromkeys(ONE_THREAD, "1"), "PYTHONPATH": str(self.checkout)}
        environment["PYTHONHASHSEED"] = "0"
        server = Path(__file__).with_name("trial_server.py")
        self._process = subprocess.Popen(
            [sys.executable, "-P", str(server)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
            cwd=self.checkout,
        )
        package = Path(self._answer()["package"])
        if not package.is_relative_to(self.checkout):
            self._process.communicate()
            raise SystemExit(f"{checkout}: is no checkout of midnet-bench; {package} was imported instead")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.communicate()

    def run(self, case: Case, seconds: float, seed: int) -> Timed:
        """Run one trial."""
        parameters = case.parameters(seconds, self.more)
        asked = {"experiment": case.experiment, "parameters": parameters, "seed": seed}
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(asked) + "\n")
        self._process.stdin.flush()
        return Timed(**self._answer())

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            self._process.communicate()
            raise SystemExit(f"{self.checkout}: its process ended; see above")
        answer: dict[str, Any] = json.loads(line)
        return answer


def pairs(
    old: Side, new: Side, case: Case, seconds: float, seeds: Sequence[int]
) -> list[tuple[Timed, Timed]]:
    """Each seed's trial on both sides, after a short one; the side that goes first alternates."""
    for side in (old, new):
        side.run(case, WARM_UP_S, seeds[0])
    timed = []
    for place, seed in enumerate(seeds):
        order = (old, new) if place % 2 == 0 else (new, old)
        answers = {side: side.run(case, seconds, seed) for side in order}
        timed.append((answers[old], answers[new]))
    return timed


def per_simulated_s(trials: Sequence[Timed]) -> float:
    """CPU seconds per simulated second of all of them together."""
    return sum(one.cpu_s for one in trials) / sum(one.simulated_s for one in trials)


def compared(name: str, timed: list[tuple[Timed, Timed]]) -> tuple[str, float]:
    """A case's line, and its median ratio."""
    sides = [[old for old, _ in timed], [new for _, new in timed]]
    ratios = [per_simulated_s([new]) / per_simulated_s([old]) for old, new in timed]
    simulated = " ".join(f"{statistics.fmean(one.simulated_s for one in side):.0f}" for side in sides)
    cpu = " ".join(f"{statistics.fmean(one.cpu_s for one in side):7.3f}" for side in sides)
    old, new = (per_simulated_s(side) for side in sides)
    cost = f"{1e3 * old:7.1f} {1e3 * new:7.1f}"
    median, spread = statistics.median(ratios), f"{min(ratios):.3f} to {max(ratios):.3f}"
    return f"{name:10} {simulated:>9} {cpu} {cost}   {median:.3f} ({spread}), all {new / old:.3f}", median


def setting(text: str) -> tuple[str, Any]:
    """``key=value``, the value as JSON if it is that, else as text."""
    key, _, value = text.partition("=")
    try:
        return key, json.loads(value)
    except ValueError:
        return key, value


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.compare",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("old", type=Path, metavar="OLD")
    parser.add_argument("new", type=Path, metavar="NEW")
    parser.add_argument("--cases", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--repeats", type=int, default=4, help="trials of each case and side, one per seed")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=60.0, help="simulated, at most")
    parser.add_argument("--old-set", action="append", default=[], metavar="KEY=VALUE", type=setting)
    parser.add_argument("--new-set", action="append", default=[], metavar="KEY=VALUE", type=setting)
    given = parser.parse_args(arguments)
    seeds = range(given.first_seed, given.first_seed + given.repeats)
    with Side(given.old, dict(given.old_set)) as old, Side(given.new, dict(given.new_set)) as new:
        print(f"OLD {old.checkout} {old.more or ''}\nNEW {new.checkout} {new.more or ''}")
        print(f"{given.repeats} trials a case, at most {given.seconds:g} simulated s; OLD's figure first")
        first = [side.run(CASES[given.cases[0]], WARM_UP_S, seeds[0]) for side in (old, new)]
        before = " ".join(f"{one.cpu_before_s:.2f}" for one in first)
        trial = " ".join(f"{one.cpu_s:.2f}" for one in first)
        print(f"start-up, CPU s: {before}; the first trial, of {WARM_UP_S:g} simulated s: {trial}")
        print(
            f"{'case':10} {'simul. s':>9} {'CPU s a trial':>15} {'ms/simul. s':>15}   NEW/OLD: median (range)"
        )
        medians = []
        for name in given.cases:
            timed = pairs(old, new, CASES[name], given.seconds, seeds)
            line, median = compared(name, timed)
            medians.append(median)
            print(line, flush=True)
        mean = math.exp(statistics.fmean(map(math.log, medians)))
        peaks = " ".join(f"{one.peak_mb:.0f}" for one in timed[-1])
        print(f"geometric mean of the medians {mean:.3f}; peak memory, MB: {peaks}")


if __name__ == "__main__":
    main()
