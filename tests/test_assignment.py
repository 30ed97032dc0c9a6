"""The assignment solver against scipy's own, and that it comes alone."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment as scipys

from midnet_bench.assignment import linear_sum_assignment


@pytest.mark.parametrize("shape", [(1, 1), (3, 5), (6, 2), (0, 4)])
@pytest.mark.parametrize("maximize", [False, True])
def test_pairs_are_scipys(shape: tuple[int, int], maximize: bool) -> None:
    costs = np.random.default_rng(1).integers(0, 4, size=shape).astype(float)
    found = linear_sum_assignment(costs, maximize)
    np.testing.assert_array_equal(found, scipys(costs, maximize))


def test_scipy_optimize_is_not_imported() -> None:
    """Its import takes longer than many a trial."""
    code = (
        "import sys, numpy; from midnet_bench.assignment import linear_sum_assignment as solve;"
        "solve(numpy.eye(2)); sys.exit('scipy.optimize' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
