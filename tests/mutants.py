"""Wrong programs that a test must notice: ``python -m tests.mutants`` prints which test notices which.

A mutant is one changed line of the package, tried in a copy of the checkout's package and tests.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
TESTS_FAILED = 1
"""pytest's exit code when tests ran and some failed; a broken import or an unknown test is another"""


@dataclass(frozen=True)
class Mutant:
    """A change of the package, and the test that must fail with it."""

    name: str
    file: str  # below ``midnet_bench/``
    old: str  # stands there exactly once
    new: str
    test: str  # below ``tests/``
    compiled: bool = True
    """whether loops are compiled; in a copy with another source of machine code that takes a minute"""


MUTANTS = [
    Mutant(
        "usable range 2.6 m instead of 2.5 m",
        "navigation/navigation_settings.py",
        "obstacle_range_m: float = option(\n        2.5,",
        "obstacle_range_m: float = option(\n        2.6,",
        "experiments/test_experiments_usable_range.py::test_usable_range_is_two_and_a_half_metres_by_default",
        compiled=False,
    ),
    Mutant(
        "who is in range is told by a constant, not by obstacle_range_m",
        "experiments/detection/trial.py",
        "range_m = scorer.test.costmap.obstacle_range_m",
        "range_m = 2.5",
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
        compiled=False,
    ),
    Mutant(
        "Eq. 11 counts who was detected, not who was caught",
        "experiments/labyrinth/trial.py",
        '"success_rate": 100.0 * caught / len(outcomes),',
        '"success_rate": 100.0 * sum(not math.isnan(one.detected_at_s) for one in outcomes) / len(outcomes),',
        "experiments/test_experiments_labyrinth.py"
        "::test_nobody_is_caught_by_a_guard_that_cannot_come_close_enough",
    ),
    Mutant(
        "guards pursue the true position of an intruder, not its box",
        "experiments/labyrinth/trial.py",
        "self.pursuit.see([box.center for box in midnet.detections], now_s)",
        "self.pursuit.see([self._place(self.intruders[0]) for _ in midnet.detections], now_s)",
        "experiments/test_experiments_labyrinth.py"
        "::test_a_guard_is_sent_to_the_box_and_not_to_the_true_position",
    ),
    Mutant(
        "a message that was overtaken replaces the newer one",
        "experiments/guarded/guarded_arena.py",
        "(newest is None or message.stamp_s > newest.stamp_s)",
        "True",
        "experiments/test_experiments_network.py::test_an_overtaken_message_is_not_gone_back_to",
    ),
]


def killed_by(mutant: Mutant, folder: Path) -> list[str]:
    """The tests that fail with ``mutant`` in a copy of the package in ``folder``; none if it lives.

    Raises:
        ValueError: the text to change does not stand exactly once in its file, or the tests did not run.
    """
    for part in ("midnet_bench", "tests", "campaigns", "results", "docs"):
        if (REPOSITORY / part).is_dir():
            shutil.copytree(REPOSITORY / part, folder / part)
    shutil.copy(REPOSITORY / "pyproject.toml", folder)
    source = folder / "midnet_bench" / mutant.file
    text = source.read_text(encoding="utf-8")
    if text.count(mutant.old) != 1:
        raise ValueError(f"{mutant.name}: not exactly once in {mutant.file}: {mutant.old}")
    source.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", f"tests/{mutant.test}", "-x", "-q", "--tb=no", "-rf"]
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
    if not mutant.compiled:
        environment["NUMBA_DISABLE_JIT"] = "1"
    done = subprocess.run(
        [*command, "-p", "no:cacheprovider", "-p", "no:xdist", f"--basetemp={folder / 'tmp'}"],
        cwd=folder,
        env={**environment, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    if done.returncode not in (0, TESTS_FAILED):
        raise ValueError(f"{mutant.name}: the tests did not run:\n{done.stdout}{done.stderr}")
    failed = [line.split()[1] for line in done.stdout.splitlines() if line.startswith("FAILED ")]
    if done.returncode == TESTS_FAILED and not failed:
        raise ValueError(f"{mutant.name}: no test failed, but one could not begin:\n{done.stdout}")
    return failed


def main() -> int:
    """Print the table; 1 if a mutant lives."""
    lives = False
    for mutant in MUTANTS:
        with tempfile.TemporaryDirectory() as folder:
            try:
                said = ", ".join(killed_by(mutant, Path(folder))) or "LIVES"
            except ValueError as error:
                said = f"LIVES: {str(error).splitlines()[0]}"
        lives |= said.startswith("LIVES")
        print(f"{mutant.name:62} {said}", flush=True)
    return int(lives)


if __name__ == "__main__":
    sys.exit(main())
