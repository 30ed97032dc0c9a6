"""A wrong program is noticed: each mutant fails the test that is named with it."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.mutants import MUTANTS


@pytest.mark.slow
def test_every_mutant_dies() -> None:
    # in a process without threads and without the package, whose modules are imported once for each mutant
    command = [sys.executable, "-m", "tests.mutants"]
    done = subprocess.run(command, cwd=Path(__file__).parents[1], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    for mutant, line in zip(MUTANTS, lines, strict=True):
        assert line.startswith(mutant.name)
        assert mutant.test in line
