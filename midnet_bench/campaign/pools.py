"""Where trials run: worker processes of this machine, or a Dask cluster; both through what joblib has."""

import contextlib
import errno
import itertools
import os
import shutil
import signal
import time
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from pathlib import Path
from typing import Protocol

# private to joblib, which pyproject.toml bounds for it
from joblib._parallel_backends import LokyBackend
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import BrokenProcessPool

from midnet_bench.campaign.signals import held_back
from midnet_bench.campaign.trial import RunTrials, TrialSpec
from midnet_bench.campaign.worker import (
    HARD_LIMIT_S,
    Outcome,
    attempt_together,
    marked,
    prepare_worker,
)
from midnet_bench.compiled import prepare_folder
from midnet_bench.errors import InputError, MidnetBenchError, nearest_name

BACKENDS = ("loky", "dask")
NO_SEMAPHORES = (errno.EROFS, errno.EACCES, errno.ENOSPC, errno.ENOENT, errno.ENOSYS)
"""error numbers of a /dev/shm that cannot be used"""
LOOK_S = 1.0
"""between two looks at how long trials have been running"""
STALLED_S = 10.0
"""after the moment at which a worker should have ended itself"""
IDLE_S = 300.0
"""after so long without a trial a worker ends; the next campaign of this process finds it before that"""


Group = Sequence[TrialSpec]
"""trials of one seed that run together; a trial alone is one too"""


class WorkersLost(Exception):
    """Workers died. What they were running is known; outcomes handed out before stay as they are.

    Attributes:
        in_flight: trial id, one of a group's -> the stack at the hard time limit, empty if the worker died
            otherwise.
    """

    def __init__(self, reason: str, in_flight: dict[str, str]) -> None:
        super().__init__(reason)
        self.in_flight = in_flight


class Pool(Protocol):
    """A place where trials run."""

    @property
    def workers(self) -> int:
        """How many trials it runs at a time, as far as it knows."""

    def outcomes(
        self, run_trials: RunTrials, groups: Iterator[Group], limit_s: float, one_at_a_time: bool
    ) -> Generator[Outcome, None, None]:
        """The outcomes of all trials in ``groups`` as they finish, in any order. Raises WorkersLost.

        No more of ``groups`` are read than the workers need; there is one at least.
        Closing the iterator abandons what is running.
        """

    def close(self) -> None:
        """Lets go of what the pool holds."""


def check_options(backend: str, jobs: int | None, scheduler: str | None) -> None:
    """Raises InputError unless the options that say where trials run go together."""
    if backend not in BACKENDS:
        raise InputError(f"--backend {backend}: unknown{nearest_name(backend, BACKENDS)}")
    if backend == "dask" and scheduler is None:
        raise InputError(
            "--backend dask: give the scheduler's address, e.g. --scheduler tcp://127.0.0.1:8786"
        )
    if backend != "dask" and scheduler is not None:
        raise InputError(f"--scheduler {scheduler}: only with --backend dask")
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}: give 1 or more")


class LokyPool:
    """Worker processes of this machine. One that dies takes the others along; new ones are started."""

    def __init__(self, jobs: int, marks: Path, note: Callable[[str], None] = lambda text: None) -> None:
        self._jobs = jobs
        self._marks = marks
        self._note = note

    @property
    def workers(self) -> int:
        """See :class:`Pool`."""
        return self._jobs

    def outcomes(
        self, run_trials: RunTrials, groups: Iterator[Group], limit_s: float, one_at_a_time: bool
    ) -> Generator[Outcome, None, None]:
        """See :meth:`Pool.outcomes`."""
        with _safe_path():
            yield from self._outcomes(run_trials, groups, limit_s, one_at_a_time)

    def _outcomes(
        self, run_trials: RunTrials, groups: Iterator[Group], limit_s: float, one_at_a_time: bool
    ) -> Generator[Outcome, None, None]:
        prepare_folder()  # before the workers start, so that they share it
        shutil.rmtree(self._marks, ignore_errors=True)  # of a process that was killed
        self._marks.mkdir(parents=True)
        first = list(itertools.islice(groups, 1 if one_at_a_time else self._jobs))
        workers, remaining = len(first), itertools.chain(first, groups)
        # not joblib.Parallel: for one job it would run the trials inside this process, where a crash ends
        # the campaign
        try:
            with held_back():
                executor = get_reusable_executor(
                    workers,
                    timeout=IDLE_S,
                    initializer=prepare_worker,
                    initargs=(os.getpid(),),
                    env=dict.fromkeys(LokyBackend.MAX_NUM_THREADS_VARS, "1"),
                )
        except OSError as error:
            if error.errno not in NO_SEMAPHORES:
                raise _no_process(error) from error
            self._note(
                f"no worker process can be started, since /dev/shm cannot be used ({error.strerror}):"
                " trials run in this process, one at a time"
            )
            for group in remaining:
                yield from attempt_together(run_trials, group, limit_s, None)
            return
        # A worker that has grown by 300 MB leaves after its trial, and loky starts another one. It warns of
        # that in the thread that looks after the workers: noise for users, and where warnings are errors it
        # ends that thread, and every trial waits for ever.
        warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
        running: set[Future[list[Outcome]]] = set()

        def submit(count: int) -> None:
            for group in itertools.islice(remaining, count):
                try:
                    with held_back():  # what is submitted is known, and it may start a worker
                        running.add(
                            executor.submit(attempt_together, run_trials, group, limit_s, self._marks)
                        )
                except (
                    OSError,
                    UnboundLocalError,
                ) as error:  # the second is loky's, where it can make no pipe
                    raise _no_process(error) from error

        try:
            submit(1 if one_at_a_time else 2 * workers)
            watch = _Watch(self._marks, limit_s)
            while running:
                done, _ = wait(running, LOOK_S, FIRST_COMPLETED)
                watch.look()
                for future in done:
                    outcomes = future.result()
                    running.remove(future)
                    yield from outcomes
                submit(len(done))
        except BrokenProcessPool as error:
            raise WorkersLost(str(error).splitlines()[0], marked(self._marks)) from error
        finally:
            if running:  # given up
                # loky stumbles over a shutdown if it has yet to take in what was submitted
                while any(not (future.running() or future.done()) for future in running):
                    time.sleep(0.001)
                executor.shutdown(kill_workers=True)
            shutil.rmtree(self._marks, ignore_errors=True)

    def close(self) -> None:
        """Nothing to let go of: idle workers end with this process."""


class _Watch:
    """How long each trial runs by this process's clock; kills a worker that ends neither it nor itself."""

    def __init__(self, marks: Path, limit_s: float) -> None:
        self._marks = marks
        self._limit_s = limit_s + HARD_LIMIT_S + STALLED_S
        self._ages_s: dict[Path, float] = {}
        self._last_s = time.monotonic()

    def look(self) -> None:
        """Kill what has stalled: a process that is stopped, or waits for a file system, stays for ever."""
        # while this process was stopped itself, nobody's time went on
        passed_s = min(time.monotonic() - self._last_s, 2 * LOOK_S)
        self._last_s = time.monotonic()
        with contextlib.suppress(OSError):  # somebody has deleted the folder
            self._ages_s = {mark: self._ages_s.get(mark, 0.0) + passed_s for mark in self._marks.iterdir()}
        for mark, age_s in self._ages_s.items():
            if age_s > self._limit_s:
                with contextlib.suppress(OSError):  # it has just ended by itself
                    mark.write_text("its worker had stalled: stopped, or waiting for a file system")
                    os.kill(int(mark.suffix[1:]), signal.SIGKILL)


def _no_process(error: Exception) -> MidnetBenchError:
    """What to say where the system refuses what worker processes need."""
    cause = error if isinstance(error, OSError) else error.__context__
    why = cause.strerror if isinstance(cause, OSError) else str(error)
    return MidnetBenchError(
        f"no worker process can be started: {why}; workers need memory and open files (ulimit -n)"
    )


@contextlib.contextmanager
def _safe_path() -> Iterator[None]:
    """Processes that begin inside import nothing from the working folder, whatever its files are called."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


def abandoning_quietly(
    outcomes: Generator[list[Outcome], None, None],
) -> Generator[list[Outcome], None, None]:
    """``outcomes``; when closed early, its workers are stopped without joblib's warning about lost work."""
    try:
        for outcome in outcomes:  # noqa: UP028 - yield from would close them before the finally
            yield outcome
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            outcomes.close()
