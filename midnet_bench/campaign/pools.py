"""Where trials run: worker processes of this machine, by joblib, or a Dask cluster."""

import contextlib
import itertools
import multiprocessing
import os
import queue
import shutil
import signal
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Protocol

import joblib

from midnet_bench.campaign.signals import SIGNALS_TO_END
from midnet_bench.campaign.trial import RunTrials, TrialSpec
from midnet_bench.campaign.worker import (
    HARD_LIMIT_S,
    Outcome,
    attempt_together,
    lock,
    marked,
    prepare_worker,
)
from midnet_bench.compiled import prepare_folder
from midnet_bench.errors import InputError, MidnetBenchError, nearest_name

BACKENDS = ("loky", "dask")
LOOK_S = 1.0
"""between two looks at how long trials have been running"""
STARTS_WITHIN_S = 1.0
"""a worker, from its process to its first trial"""
KILL_AGAIN_S = 0.05
"""between two rounds of ending workers: one may be starting during the first"""
NOTHING_BEGINS_S = 120.0
"""without any running trial: the system has refused a new worker, of which joblib does not tell"""
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
        if reason := _why_no_processes():
            self._note(
                f"no worker process can be started, since /dev/shm cannot be used ({reason}):"
                " trials run in this process, one at a time"
            )
            for group in groups:
                yield from attempt_together(run_trials, group, limit_s, None)
            return
        prepare_folder()  # before the workers start, so that they share it
        shutil.rmtree(self._marks, ignore_errors=True)  # of a process that was killed
        try:
            self._marks.mkdir(parents=True)
        except OSError as error:
            raise InputError(f"{self._marks}: {error.strerror}; remove it, or give another -o") from error
        first = list(itertools.islice(groups, 1 if one_at_a_time else self._jobs))
        tasks = (
            joblib.delayed(attempt_together)(run_trials, group, limit_s, self._marks)
            for group in itertools.chain(first, groups)
        )
        with _safe_path():
            workers = _Workers(tasks, max(1, len(first)), self._marks)
            watch = _Watch(self._marks, limit_s)
            try:
                while (outcomes := workers.next(LOOK_S)) is not None:
                    yield from outcomes
                    watch.look()
            except BrokenProcessPool as error:
                raise WorkersLost(str(error).splitlines()[0], marked(self._marks)) from error
            # the second is joblib's, where it can make no pipe
            except (OSError, UnboundLocalError) as error:
                raise _no_process(error) from error
            finally:
                workers.close()
                shutil.rmtree(self._marks, ignore_errors=True)

    def close(self) -> None:
        """Nothing to let go of: idle workers end with this process."""


class _Workers:
    """Runs tasks by joblib, in a thread of its own.

    Python raises KeyboardInterrupt in the main thread alone: inside joblib it could leave a lock behind that
    every other thread waits for. Signals to end are blocked in joblib's thread and so in its workers.
    """

    def __init__(self, tasks: Iterable[object], count: int, marks: Path) -> None:
        self._is_cancelled = False
        self._tasks = itertools.takewhile(lambda task: not self._is_cancelled, tasks)
        self._marks = marks
        self._count = count
        self._results: queue.SimpleQueue[list[Outcome] | BaseException | None] = queue.SimpleQueue()
        self._is_over = False
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        resource_tracker.ensure_running()  # joblib would start it, and Python unblocks signals when it starts
        if hasattr(signal, "pthread_sigmask"):  # not on Windows
            signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS_TO_END)
        # A worker that has grown by 300 MB leaves after its trial, and joblib starts another one and warns.
        warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
        end: BaseException | None = None
        try:
            with joblib.parallel_config(backend="loky", inner_max_num_threads=1):
                parallel = joblib.Parallel(
                    n_jobs=max(2, self._count),  # a single job would run in this process
                    return_as="generator_unordered",
                    pre_dispatch=1 if self._count == 1 else 2 * self._count,
                    batch_size=1,
                    max_nbytes=None,
                    initializer=prepare_worker,
                    initargs=(os.getpid(),),
                    idle_worker_timeout=IDLE_S,
                )
                for outcomes in parallel(self._tasks):
                    self._results.put(outcomes)
        except BaseException as error:
            end = error
        self._is_over = True
        self._results.put(end)

    def next(self, wait_s: float) -> list[Outcome] | None:
        """The outcomes of a task, empty if none has finished within ``wait_s``; None after the last one.

        Raises what joblib raised.
        """
        try:
            result = self._results.get(timeout=wait_s)
        except queue.Empty:
            return []
        if isinstance(result, BaseException):
            raise result
        return result

    def close(self) -> None:
        """Kills the workers that are in a trial."""
        self._is_cancelled = True
        start_s = time.monotonic()
        while self._thread.is_alive():
            if not self._is_over:
                waited_s = time.monotonic() - start_s
                marks = list(self._marks.glob("*.*"))
                # joblib warns of semaphores that a worker left which had only begun to load them
                if len(marks) == len(_worker_pids()) or waited_s > STARTS_WITHIN_S:
                    for mark in marks:
                        _kill_in_trial(mark)
                if waited_s > STALLED_S:  # such as trials without a mark, on a full disk
                    for pid in _worker_pids():
                        _kill(pid)
            self._thread.join(KILL_AGAIN_S)


def _worker_pids() -> list[int]:
    """Joblib's among the children of this process."""
    children = multiprocessing.active_children()
    return [child.pid for child in children if child.name.startswith("Loky") and child.pid is not None]


def _kill_in_trial(mark: Path) -> None:
    """Kill the worker of a mark unless it has left its trial.

    One that is killed while it hands over a result leaves a part of it in a pipe, and joblib waits for the
    rest for ever. So a worker locks its mark before it leaves a trial, and the parent before it kills.
    """
    if (pid := _worker_of(mark)) is None:
        return
    with contextlib.suppress(OSError), mark.open("rb") as file:  # it has left, or is about to
        lock(file, wait=False)
        if mark.exists():
            _kill(pid)


def _worker_of(mark: Path) -> int | None:
    """The process of joblib's that a mark is of; None if the file is none of ours."""
    return next((pid for pid in _worker_pids() if mark.suffix == f".{pid}"), None)


def _kill(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):  # it has just ended by itself
        os.kill(pid, signal.SIGKILL)


def _why_no_processes() -> str:
    """Why this machine has no semaphores for worker processes; empty where it has."""
    try:
        multiprocessing.Lock()
    except (OSError, ImportError) as error:
        return getattr(error, "strerror", None) or str(error)
    return ""


class _Watch:
    """How long each trial runs by this process's clock; kills a worker that ends neither it nor itself."""

    def __init__(self, marks: Path, limit_s: float) -> None:
        self._marks = marks
        self._limit_s = limit_s + HARD_LIMIT_S + STALLED_S
        self._ages_s: dict[Path, float] = {}
        self._idle_s = 0.0
        self._last_s = time.monotonic()

    def look(self) -> None:
        """Kills what has stalled: a process that is stopped, or waits for a file system, stays for ever.

        Raises MidnetBenchError if nothing runs at all.
        """
        # while this process was stopped itself, nobody's time went on
        passed_s = min(time.monotonic() - self._last_s, 2 * LOOK_S)
        self._last_s = time.monotonic()
        with contextlib.suppress(OSError):  # somebody has deleted the folder
            self._ages_s = {mark: self._ages_s.get(mark, 0.0) + passed_s for mark in self._marks.iterdir()}
        self._idle_s = 0.0 if self._ages_s else self._idle_s + passed_s
        if self._idle_s > NOTHING_BEGINS_S:
            raise MidnetBenchError(
                f"no worker process has begun a trial for {NOTHING_BEGINS_S:g} s; workers need memory, open"
                " files and processes (ulimit -n, -u)"
            )
        for mark, age_s in self._ages_s.items():
            if age_s > self._limit_s and (pid := _worker_of(mark)) is not None:
                with contextlib.suppress(OSError):  # somebody has deleted the folder
                    mark.write_text("its worker had stalled: stopped, or waiting for a file system")
                _kill(pid)


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
