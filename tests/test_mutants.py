"""A wrong program is noticed: each mutant fails the test that is named with it."""

from pathlib import Path

import pytest

from tests.mutants import MUTANTS, Mutant, killed_by


@pytest.mark.slow
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name.replace(" ", "-"))
def test_a_mutant_dies(mutant: Mutant, tmp_path: Path) -> None:
    assert killed_by(mutant, tmp_path), f"no test of {mutant.test} notices: {mutant.name}"
