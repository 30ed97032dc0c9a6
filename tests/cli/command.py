"""The command line as a user gives it: in this process where that is enough, else in one of its own."""

import contextlib
import csv
import io
import logging
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from midnet_bench.campaign import pool as pools
from midnet_bench.campaign.child import attempt
from midnet_bench.campaign.trial import Outcome, RunTrials
from midnet_bench.cli import main

REPOSITORY = Path(__file__).parents[2]
MAP_KEYS = {
    "image": "map.pgm",
    "resolution": 0.05,
    "origin": [-4.0, -4.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}
"""a map of Map 1's size, which ``map.pgm`` beside it has the cells of"""


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    returncode: int
    stdout: str
    stderr: str


def midnet_bench(*arguments: object, folder: Path) -> Done:
    """``midnet-bench`` in this process, which is as it was afterwards; an escaping exception is a failure.

    Trials run in this process too. Those of a command with ``--jobs`` run in workers.
    """
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", newline="") for _ in range(2))
    argv = ["midnet-bench", *map(str, arguments)]
    outcomes = pools.LocalPool.outcomes if "--jobs" in argv else without_workers
    with (
        _process_left_as_it_is(),
        mock.patch.object(pools.LocalPool, "outcomes", outcomes),
        contextlib.chdir(folder),
        mock.patch.dict(os.environ, {"NO_COLOR": "1"}),
        mock.patch.object(sys, "argv", argv),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        code: object = 0
        try:
            main()
        except SystemExit as ended:
            code = ended.code
    assert isinstance(code, int | None), code
    return Done(code or 0, _written(out), _written(err))


def worked(*arguments: object, folder: Path) -> Done:
    """The same of a command that has to end well."""
    done = midnet_bench(*arguments, folder=folder)
    assert done.returncode == 0, done.stderr
    return done


def unpainted() -> contextlib.AbstractContextManager[object]:
    """Figures become empty files meanwhile: to draw one takes longer than all else that a report does."""
    empty = {".png": b"", ".svg": b""}
    return mock.patch("midnet_bench.drawing.charts.chart_files", return_value=empty)


def in_its_own_process(
    *arguments: object, folder: Path, environment: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """``python -m midnet_bench``: for what only a whole process can show."""
    command = [sys.executable, "-m", "midnet_bench", *map(str, arguments)]
    variables = {**os.environ, "NO_COLOR": "1", "PYTHONPATH": str(REPOSITORY), **(environment or {})}
    return subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True, timeout=300)


def without_workers(
    pool: object, run_trials: RunTrials, groups: Iterator[pools.Group], limit_s: float
) -> Iterator[Outcome]:
    """As the pool does it, in this process and without a time limit."""
    for group in groups:
        yield from attempt(run_trials, group)


@contextlib.contextmanager
def _process_left_as_it_is() -> Iterator[None]:
    """Signals and logging after this are what they were before."""
    handler = signal.getsignal(signal.SIGINT)
    loggers = [logging.getLogger(name) for name in (None, "midnet_bench")]
    logging_before = [(logger, logger.level, list(logger.handlers)) for logger in loggers]
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        for logger, level, handlers in logging_before:
            logger.setLevel(level)
            logger.handlers[:] = handlers


def _written(stream: io.TextIOWrapper) -> str:
    stream.flush()
    buffer = stream.buffer
    assert isinstance(buffer, io.BytesIO)
    return buffer.getvalue().decode()


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def one_line_of_complaint(done: Done | subprocess.CompletedProcess[str]) -> str:
    """What a command says to wrong input: exit code 2, and one line on stderr, which comes back."""
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    (complaint,) = done.stderr.strip().splitlines()
    return complaint
