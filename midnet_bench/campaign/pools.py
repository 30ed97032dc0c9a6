"""Where trials run: worker processes of this machine, or a Dask cluster; both through what joblib has."""

import contextlib
import itertools
import os
import shutil
import signal
import time
import warnings
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Protocol

# private to joblib, which pyproject.toml bounds for it
from joblib._parallel_backends import LokyBackend
from joblib.externals.loky import get_reusable_executor
from joblib.externals.loky.process_executor import BrokenProcessPool

from midnet_bench.campaign.trial import RunTrial, TrialSpec
from midnet_bench.campaign.worker import Outcome, attempt, marked, prepare_worker
from midnet_bench.errors import InputError, nearest_name

BACKENDS = ("loky", "dask")
IDLE_S = 300.0
"""after so long without a trial a worker ends; the next campaign of this process finds it before that"""


class WorkersLost(Exception):
    """Workers died. What they were running is known; outcomes handed out before stay as they are.

    Attributes:
        in_flight: trial id -> the stack at the hard time limit, empty if the worker died otherwise.
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
        self, run_trial: RunTrial, specs: Sequence[TrialSpec], limit_s: float, one_at_a_time: bool
    ) -> Generator[Outcome, None, None]:
        """The outcomes of ``specs`` as they finish, in any order. Raises WorkersLost.

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

    def __init__(self, jobs: int, marks: Path) -> None:
        self._jobs = jobs
        self._marks = marks

    @property
    def workers(self) -> int:
        """See :class:`Pool`."""
        return self._jobs

    def outcomes(
        self, run_trial: RunTrial, specs: Sequence[TrialSpec], limit_s: float, one_at_a_time: bool
    ) -> Generator[Outcome, None, None]:
        """See :meth:`Pool.outcomes`."""
        shutil.rmtree(self._marks, ignore_errors=True)  # of a process that was killed
        self._marks.mkdir(parents=True)
        workers = 1 if one_at_a_time else min(self._jobs, len(specs))
        # not joblib.Parallel: for one job it would run the trials inside this process, where a crash ends
        # the campaign
        executor = get_reusable_executor(
            workers,
            timeout=IDLE_S,
            initializer=prepare_worker,
            initargs=(os.getpid(),),
            env=dict.fromkeys(LokyBackend.MAX_NUM_THREADS_VARS, "1"),
        )
        # A worker that has grown by 300 MB leaves after its trial, and loky starts another one. It warns of
        # that in the thread that looks after the workers: noise for users, and where warnings are errors it
        # ends that thread, and every trial waits for ever.
        warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
        remaining = iter(specs)
        running: set[Future[Outcome]] = set()

        def submit(count: int) -> None:
            for spec in itertools.islice(remaining, count):
                running.add(executor.submit(attempt, run_trial, spec, limit_s, self._marks))

        try:
            with _interrupts_held_back():
                submit(1 if one_at_a_time else 2 * workers)  # starts the workers
            while running:
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    outcome = future.result()
                    running.remove(future)
                    yield outcome
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


@contextlib.contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Ctrl-C waits for the end of this in this process, and is never heard in those that begin inside.

    A terminal sends it to the workers too, and one that is still loading its libraries would end with a
    traceback: :func:`prepare_worker` is called after that.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # joblib would start it inside, and with it Python lets signals through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def abandoning_quietly(outcomes: Generator[Outcome, None, None]) -> Generator[Outcome, None, None]:
    """``outcomes``; when closed early, its workers are stopped without joblib's warning about lost work."""
    try:
        for outcome in outcomes:  # noqa: UP028 - yield from would close them before the finally
            yield outcome
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            outcomes.close()
