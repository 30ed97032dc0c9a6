"""Optimal assignment: scipy's ``linear_sum_assignment`` without the rest of ``scipy.optimize``."""

import importlib.util
from collections.abc import Callable
from functools import cache
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[np.int64]


def linear_sum_assignment(costs: npt.NDArray[np.float64], maximize: bool = False) -> tuple[Ints, Ints]:
    """Rows, ascending, and columns, (min(n, m),) each, of the pairs with the least sum of (n, m) ``costs``.

    The greatest sum with ``maximize``. See scipy's function of the same name.
    """
    rows, columns = _solver()(costs, maximize)
    return rows, columns


@cache
def _solver() -> Callable[..., Any]:
    """The compiled function, from its own file: importing the package takes each process half a second.

    That file's place is private to scipy. Where nothing is found there, the package is imported after all.
    """
    package = importlib.util.find_spec("scipy")
    folders = [] if package is None else list(package.submodule_search_locations or ())
    spec = PathFinder.find_spec("_lsap", [str(Path(folder) / "optimize") for folder in folders])
    if spec is None or spec.loader is None:
        from scipy.optimize import linear_sum_assignment as whole

        return whole
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    solver: Callable[..., Any] = module.linear_sum_assignment
    return solver
