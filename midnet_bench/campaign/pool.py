"""Trials in worker processes of this machine, by joblib: limited in time, failures caught, none lost."""

import contextlib
import faulthandler
import itertools
import multiprocessing
import os
import queue
import shutil
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import resource_tracker
from pathlib import Path
from types import FrameType
from typing import IO, Any, Protocol

import joblib
from joblib._parallel_backends import LokyBackend
from joblib.executor import get_memmapping_executor

from midnet_bench import compiled
from midnet_bench.campaign.trial import Outcome, RunTrials, TrialResult, TrialSpec, encode_tables
from midnet_bench.errors import InputError, MidnetBenchError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

SIGNALS_TO_END = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""Ctrl-C; what schedulers send; a terminal that is closed. All processes of a campaign get them."""
HARD_LIMIT_S = 2.0
"""native code that goes on this long after the time limit is ended together with its process"""
LOOK_S = 1.0  # between two looks at how long trials have been running
STARTS_WITHIN_S = 1.0  # a worker, from its process to its first trial
KILL_AGAIN_S = 0.05  # between two rounds of ending workers: one may be starting during the first
NOTHING_BEGINS_S = 120.0
"""without any running trial: the system has refused a new worker, of which joblib does not tell"""
STALLED_S = 10.0  # after the moment at which a worker should have ended itself
IDLE_S = 300.0
"""after so long without a trial a worker ends; the next campaign of this process finds it before that"""

Group = Sequence[TrialSpec]  # trials of one seed that run together; a trial alone is one too


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


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """The first signal to end raises KeyboardInterrupt with its number, a second one ends all at once."""

    def interrupt(signum: int, frame: FrameType | None) -> None:
        for number in before:
            signal.signal(number, signal.SIG_DFL)
        if _heard is None:
            raise KeyboardInterrupt(signum)
        _heard.append(signum)

    if threading.current_thread() is not threading.main_thread():  # Python delivers signals to no other
        yield
        return
    # what nohup ignores stays ignored; SIGINT is ignored wherever a script starts a campaign behind itself
    before = {
        number: handler
        for number in SIGNALS_TO_END
        if (handler := signal.getsignal(number)) is not None
        if number == signal.SIGINT or handler is not signal.SIG_IGN
    }
    try:
        for number in before:
            signal.signal(number, interrupt)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


_heard: list[int] | None = None
"""the signals to end that came inside :func:`uninterrupted`; None outside"""


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """KeyboardInterrupt comes after what is done inside: it could leave that half done, or a lock behind."""
    global _heard
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard: list[int] = []
    _heard = heard
    try:
        yield
    finally:
        _heard = None
    if heard:
        raise KeyboardInterrupt(*heard)


# In a worker


def prepare_worker(parent_pid: int) -> None:
    """Called once in a fresh worker: to end is the parent's business, and no worker outlives its parent."""
    compiled.collect_garbage_rarely()
    for number in SIGNALS_TO_END:
        signal.signal(number, signal.SIG_IGN)

    def leave_with_parent() -> None:
        while os.getppid() == parent_pid:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=leave_with_parent, daemon=True).start()


def attempt(
    run_trials: RunTrials, specs: Sequence[TrialSpec], limit_s: float, marks: Path | None = None
) -> list[Outcome]:
    """The outcomes of trials that share a simulation; no exception leaves it but Ctrl-C's.

    Each gets an equal part of the wall time. Where they cannot be run together, or not within the time limit
    of one trial, each is run alone.

    While they run, a file named by the first and by the process stands in ``marks``, so that the parent knows
    what a worker does, or did when it died. A trial over its limit is interrupted; if it sits in native code
    that cannot be interrupted, its process ends and the mark keeps the stack.
    """
    start_s = time.perf_counter()
    results: list[dict[str, Any]] | None = None
    with _mark(marks, specs[0].trial_id) as stack_file:
        try:
            with _time_limit(limit_s, stack_file):
                _use_one_thread()
                results = [_packed(result) for result in run_trials(specs)]
        except KeyboardInterrupt:  # workers never hear it: this is the campaign's own process
            raise
        except BaseException as error:
            faulthandler.cancel_dump_traceback_later()
            failure = traceback.format_exc().strip()
            if isinstance(error, _TrialTimeout):
                failure += f": still running after its limit of {limit_s:g} s of wall time"
            results = [{"failure": failure}] if len(specs) == 1 else None
    if results is None:
        return [outcome for spec in specs for outcome in attempt(run_trials, [spec], limit_s, marks)]
    wall_s = (time.perf_counter() - start_s) / len(specs)
    if marks is not None:  # in a worker
        compiled.collect_garbage_of_trial()
    return [Outcome(spec.trial_id, wall_s, **packed) for spec, packed in zip(specs, results, strict=True)]


def _packed(result: TrialResult | Exception) -> dict[str, Any]:
    """The fields of an outcome: simulated time and tables ready to store, or the failure."""
    try:
        if isinstance(result, Exception):
            raise result
        return {"simulated_s": float(result.simulated_s), "payload": encode_tables(result)}
    except Exception:
        return {"failure": traceback.format_exc().strip()}


class _TrialTimeout(BaseException):
    """The trial's wall time is over. Not an Exception, so that no handler in a trial can swallow it."""


@contextlib.contextmanager
def _mark(marks: Path | None, trial_id: str) -> Iterator[IO[str]]:
    mark = None if marks is None else marks / f"{trial_id}.{os.getpid()}"
    try:
        stack_file = None if mark is None else mark.open("x")
    except OSError:  # no room for a mark is no reason to lose the trial
        stack_file = None
    if mark is None or stack_file is None:
        yield sys.__stderr__ or sys.stderr
        return
    with stack_file:
        try:
            faulthandler.enable(stack_file)  # the stack of a crash stands in the mark as well
            yield stack_file
        finally:
            faulthandler.enable()
            with contextlib.suppress(OSError):  # a file system without locks
                _lock(stack_file, wait=True)  # the parent that has it kills this process
            mark.unlink(missing_ok=True)  # it may be gone with its folder


def _lock(file: IO[Any], wait: bool) -> None:
    """Lock a file until it is closed. Raises OSError if another process has it and ``wait`` is off."""
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextlib.contextmanager
def _time_limit(limit_s: float, stack_file: IO[str]) -> Iterator[None]:
    """Raises _TrialTimeout when ``limit_s`` is over; two seconds later, ends the process by force.

    Python delivers signals to the main thread alone: in others, as on a Dask worker, force is all there is.
    """

    def interrupt(signum: int, frame: FrameType | None) -> None:
        raise _TrialTimeout

    faulthandler.dump_traceback_later(limit_s + HARD_LIMIT_S, exit=True, file=stack_file)
    has_alarm = hasattr(signal, "setitimer") and threading.current_thread() is threading.main_thread()
    if has_alarm:
        signal.signal(signal.SIGALRM, interrupt)
        signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        if has_alarm:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        faulthandler.cancel_dump_traceback_later()


def _use_one_thread() -> None:
    """OpenCV's own pool would fight the other workers for the cores; loky sets what BLAS and numba obey."""
    os.environ["OPENCV_FOR_THREADS_NUM"] = "1"  # for a trial that has yet to import it
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(1)


# In the campaign's own process


class LokyPool:
    """Worker processes of this machine. One that dies takes the others along; new ones are started."""

    def __init__(self, jobs: int, marks: Path, note: Callable[[str], None] = lambda text: None) -> None:
        self.workers = jobs
        self._marks = marks
        self._note = note

    def outcomes(
        self, run_trials: RunTrials, groups: Iterator[Group], limit_s: float, one_at_a_time: bool
    ) -> Generator[Outcome, None, None]:
        """See :meth:`Pool.outcomes`."""
        try:
            multiprocessing.Lock()
        except (OSError, ImportError) as error:
            reason = getattr(error, "strerror", None) or error
            self._note(
                f"no worker process can be started, since /dev/shm cannot be used ({reason}):"
                " trials run in this process, one at a time"
            )
            for group in groups:
                yield from attempt(run_trials, group, limit_s)
            return
        compiled.folder()  # before the workers start, so that they share it
        shutil.rmtree(self._marks, ignore_errors=True)  # of a process that was killed
        try:
            self._marks.mkdir(parents=True)
        except OSError as error:
            raise InputError(f"{self._marks}: {error.strerror}; remove it, or give another -o") from error
        first = list(itertools.islice(groups, 1 if one_at_a_time else self.workers))
        tasks = (
            joblib.delayed(attempt)(run_trials, group, limit_s, self._marks)
            for group in itertools.chain(first, groups)
        )
        with _safe_path():
            workers = _Workers(tasks, max(1, len(first)), self._marks, limit_s)
            try:
                while (outcomes := workers.next()) is not None:
                    yield from outcomes
                    workers.kill_stalled()
            except BrokenProcessPool as error:
                in_flight = {mark.stem: mark.read_text(errors="replace") for mark in workers.marks()}
                raise WorkersLost(str(error).splitlines()[0], in_flight) from error
            # the second is joblib's, where it can make no pipe
            except (OSError, UnboundLocalError) as error:
                cause = error if isinstance(error, OSError) else error.__context__
                why = cause.strerror if isinstance(cause, OSError) else str(error)
                raise MidnetBenchError(
                    f"no worker process can be started: {why}; workers need memory and open files (ulimit -n)"
                ) from error
            finally:
                workers.close()
                shutil.rmtree(self._marks, ignore_errors=True)

    def close(self) -> None:
        """Nothing to let go of: idle workers end with this process."""


class _Backend(LokyBackend):  # type: ignore[misc] # joblib has no types
    """Joblib's, but one trial at a time needs one worker: joblib has two, or runs trials in this process."""

    def __init__(self, workers: int, **more: Any) -> None:
        super().__init__(**more)
        self._count = workers

    def configure(
        self, n_jobs: int, parallel: Any, idle_worker_timeout: float, prefer: Any, require: Any, **more: Any
    ) -> int:
        """As joblib has it: begins to use worker processes, and returns ``n_jobs``."""
        self.parallel, env = parallel, self._prepare_worker_env(self._count)
        more |= {"timeout": idle_worker_timeout, "env": env, "context_id": parallel._id}
        self._workers = get_memmapping_executor(self._count, **more)
        return n_jobs


class _Workers:
    """Runs tasks by joblib, in a thread of its own, and kills workers that stall.

    Python raises KeyboardInterrupt in the main thread alone: inside joblib it could leave a lock behind that
    every other thread waits for. Signals to end are blocked in joblib's thread and so in its workers.
    """

    def __init__(self, tasks: Iterator[object], count: int, folder: Path, limit_s: float) -> None:
        self._is_cancelled = self._is_over = False
        self._tasks = itertools.takewhile(lambda task: not self._is_cancelled, tasks)
        self._count = count
        self._folder = folder
        self._limit_s = limit_s + HARD_LIMIT_S + STALLED_S
        self._ages_s: dict[Path, float] = {}
        self._idle_s, self._last_s = 0.0, time.monotonic()
        self._results: queue.SimpleQueue[list[Outcome] | BaseException | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._run, daemon=True)
        with uninterrupted():
            self._thread.start()

    def _run(self) -> None:
        resource_tracker.ensure_running()  # joblib would start it, and Python unblocks signals when it starts
        if hasattr(signal, "pthread_sigmask"):  # not on Windows
            signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS_TO_END)
        # A worker that has grown by 300 MB leaves after its trial, and joblib starts another one and warns.
        warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)
        end: BaseException | None = None
        try:
            with joblib.parallel_config(backend=_Backend(self._count, inner_max_num_threads=1)):
                parallel = joblib.Parallel(
                    n_jobs=max(2, self._count),  # joblib would run a single job without its backend
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

    def next(self) -> list[Outcome] | None:
        """The outcomes of a task, empty if none has finished within ``LOOK_S``; None after the last one.

        Raises what joblib raised.
        """
        try:
            result = self._results.get(timeout=LOOK_S)
        except queue.Empty:
            return []
        if isinstance(result, BaseException):
            raise result
        return result

    def marks(self) -> list[Path]:
        """A file for each trial that runs, or was running when its worker ended."""
        try:
            # one call that no signal interrupts: a glob that one leaves half read warns at the exit
            names = os.listdir(self._folder)
        except (FileNotFoundError, NotADirectoryError):  # the results were deleted
            return []
        return sorted(self._folder / name for name in names if "." in name)

    def kill_stalled(self) -> None:
        """Kills workers that end neither their trial nor themselves: stopped, or waiting for a file system.

        Raises MidnetBenchError if nothing runs at all.
        """
        # by this process's clock; while it was stopped itself, nobody's time went on
        now_s = time.monotonic()
        passed_s, self._last_s = min(now_s - self._last_s, 2 * LOOK_S), now_s
        self._ages_s = {mark: self._ages_s.get(mark, 0.0) + passed_s for mark in self.marks()}
        self._idle_s = 0.0 if self._ages_s else self._idle_s + passed_s
        if self._idle_s > NOTHING_BEGINS_S:
            raise MidnetBenchError(
                f"no worker process has begun a trial for {NOTHING_BEGINS_S:g} s; workers need memory, open"
                " files and processes (ulimit -n, -u)"
            )
        for mark, age_s in self._ages_s.items():
            if age_s > self._limit_s and (pid := _worker_of(mark)) is not None:
                with contextlib.suppress(OSError):  # the folder was deleted
                    mark.write_text("its worker had stalled: stopped, or waiting for a file system")
                _kill(pid)

    def close(self) -> None:
        """Kills the workers that are in a trial, and waits for joblib's thread.

        A worker that is killed while it hands over a result leaves a part of it in a pipe, and joblib waits
        for the rest for ever. So a worker locks its mark before it leaves a trial, and this process before it
        kills.
        """
        self._is_cancelled = True
        start_s = time.monotonic()
        while self._thread.is_alive():
            waited_s = time.monotonic() - start_s
            marks = self.marks()
            # joblib warns of semaphores that a worker left which had only begun to load them
            if not self._is_over and (len(marks) == len(_worker_pids()) or waited_s > STARTS_WITHIN_S):
                for mark in marks:
                    if (pid := _worker_of(mark)) is not None:
                        # it has left its trial, or is about to
                        with contextlib.suppress(OSError), mark.open("rb") as file:
                            _lock(file, wait=False)
                            if mark.exists():
                                _kill(pid)
            if not self._is_over and waited_s > STALLED_S:  # such as trials without a mark, on a full disk
                for pid in _worker_pids():
                    _kill(pid)
            self._thread.join(KILL_AGAIN_S)


def _worker_pids() -> list[int]:
    """Joblib's among the children of this process."""
    children = multiprocessing.active_children()
    return [child.pid for child in children if child.name.startswith("Loky") and child.pid is not None]


def _worker_of(mark: Path) -> int | None:
    """The process of joblib's that a mark is of; None if the file is none of ours."""
    return next((pid for pid in _worker_pids() if mark.suffix == f".{pid}"), None)


def _kill(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError):  # it has just ended by itself
        os.kill(pid, signal.SIGKILL)


@contextlib.contextmanager
def _safe_path() -> Iterator[None]:
    """Processes that begin inside import nothing from the working folder, whatever its files are called."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        del os.environ["PYTHONSAFEPATH"]
        if before is not None:
            os.environ["PYTHONSAFEPATH"] = before
