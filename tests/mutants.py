"""Wrong programs that a test must notice: ``python -m tests.mutants`` prints which test notices which.

A mutant is one changed line of the package. It is imported in a forked process, where its test runs; no file
is changed, and machine code that is kept stays what it was.
"""

import importlib
import os
import sys
import tempfile
from dataclasses import dataclass
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import CodeType

import pytest

from midnet_bench.compiled import numba

PACKAGE = Path(__file__).parents[1] / "midnet_bench"
LIBRARIES = ("cv2", "joblib", "matplotlib.figure", "numba", "pandas", "pydantic", "scipy.optimize")
"""what every process would import for itself"""


@dataclass(frozen=True)
class Mutant:
    """A change of the package, and the test that must fail with it."""

    name: str
    file: str  # below ``midnet_bench/``
    old: str  # stands there exactly once
    new: str
    test: str  # below ``tests/``

    @property
    def module(self) -> str:
        """The module's name."""
        return f"midnet_bench.{self.file.removesuffix('.py').replace('/', '.')}"

    @property
    def source(self) -> str:
        """The changed module. Raises ValueError if the line is not there."""
        text = (PACKAGE / self.file).read_text(encoding="utf-8")
        if text.count(self.old) != 1:
            raise ValueError(f"not exactly once in {self.file}: {self.old}")
        return text.replace(self.old, self.new)


MUTANTS = [
    Mutant(
        "usable range 2.6 m instead of 2.5 m",
        "navigation/navigation_settings.py",
        "obstacle_range_m: float = option(\n        2.5,",
        "obstacle_range_m: float = option(\n        2.6,",
        "experiments/test_experiments_usable_range.py::test_usable_range_is_two_and_a_half_metres_by_default",
    ),
    Mutant(
        "who is in range is told by a constant, not by obstacle_range_m",
        "experiments/detection/trial.py",
        "range_m, rule = scorer.test.usable_range_m,",
        "range_m, rule = 2.5,",
        "experiments/test_experiments_usable_range.py::test_usable_range_follows_obstacle_range",
    ),
    Mutant(
        "golden bounds agree with anything",
        "workflows/verify.py",
        "return abs(float(ours) - float(golden)) <= drift.absolute + drift.share * abs(float(golden))",
        "return True",
        "workflows/test_smoke.py::test_elsewhere_a_number_may_lie_off_by_so_much",
    ),
    Mutant(
        "stuck after 8 s instead of 5 s",
        "simulation/fleet.py",
        "STUCK_AFTER_S = 5.0",
        "STUCK_AFTER_S = 8.0",
        "simulation/test_simulation_fleet.py::test_a_stand_counts_from_five_seconds_on",
    ),
    Mutant(
        "Eq. 11 counts who was detected, not who was caught",
        "experiments/labyrinth/trial.py",
        '"success_rate": 100.0 * caught / len(outcomes),',
        '"success_rate": 100.0 * sum(not math.isnan(one.detected_at_s) for one in outcomes) / len(outcomes),',
        "experiments/test_experiments_labyrinth.py"
        "::test_who_is_not_come_close_to_is_not_caught_and_gone_at_his_escape",
    ),
    Mutant(
        "guards pursue the true position of an intruder, not its box",
        "experiments/labyrinth/trial.py",
        "self.pursuit.see(midnet.detections, squares, now_s)",
        "self.pursuit.see([Box.square(*self._place(self.intruders[0]), 0.2)], squares, now_s)",
        "experiments/test_experiments_labyrinth.py"
        "::test_a_guard_is_sent_to_the_box_and_not_to_the_true_position",
    ),
    Mutant(
        "what a guard pursues keeps the others' patrol points away",
        "agents/patrol.py",
        "if i != guard and not one.is_pursuing]",
        "if i != guard]",
        "agents/test_patrol.py::test_a_goal_that_a_mate_pursues_keeps_no_patrol_point_away",
    ),
    Mutant(
        "a box on a guard is a target",
        "agents/pursuit.py",
        "if not any(box.intersection_area(guard) > 0.0 for guard in guards)]",
        "]",
        "agents/test_pursuit.py::test_no_rule_gets_a_box_on_a_guard_whichever_it_is[0-nearest]",
    ),
    Mutant(
        "a message that was overtaken replaces the newer one",
        "experiments/guarded/guarded_arena.py",
        "(newest is None or message.stamp_s > newest.stamp_s)",
        "True",
        "experiments/test_experiments_network.py::test_an_overtaken_message_is_not_gone_back_to",
    ),
]


class Failures:
    """A plug-in of pytest that notes the tests that fail; one that cannot begin counts as none."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Note it."""
        if report.failed and report.when == "call":
            self.names.append(report.nodeid)


def killers(mutant: Mutant) -> str:
    """The tests that fail with ``mutant``, or ``LIVES`` and why; this process has it from then on."""
    get_code = SourceFileLoader.get_code

    def mutated(loader: SourceFileLoader, name: str) -> CodeType | None:
        is_it = name == mutant.module
        return compile(mutant.source, loader.path, "exec") if is_it else get_code(loader, name)

    SourceFileLoader.get_code = mutated  # type: ignore[method-assign]
    try:
        if "njit" in mutant.source:  # machine code is found by the file, which is unchanged
            numba().config.DISABLE_JIT = 1
    except ValueError as error:
        return f"LIVES: {error}"
    found = Failures()
    options = ["-x", "-q", "--tb=no", "-p", "no:cacheprovider", "-p", "no:xdist"]
    with tempfile.TemporaryDirectory() as folder:
        pytest.main([f"tests/{mutant.test}", *options, f"--basetemp={folder}/tmp"], [found])
    return ", ".join(found.names) or "LIVES"


def in_a_fork(mutant: Mutant) -> str:
    """The same, from a forked process."""
    reading, writing = os.pipe()
    if not (pid := os.fork()):
        try:
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.write(writing, killers(mutant).encode())
        finally:
            os._exit(0)
    os.close(writing)
    with open(reading, encoding="utf-8") as file:
        said = file.read()
    os.waitpid(pid, 0)
    return said or "LIVES: its process died"


def main() -> int:
    """Print the table; 1 if a mutant lives."""
    for name in LIBRARIES:
        importlib.import_module(name)
    os.chdir(PACKAGE.parent)
    table = {mutant.name: in_a_fork(mutant) for mutant in MUTANTS}
    for name, said in table.items():
        print(f"{name:62} {said}")
    return int(any(said.startswith("LIVES") for said in table.values()))


if __name__ == "__main__":
    sys.exit(main())
