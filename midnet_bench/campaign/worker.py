"""One trial inside a worker process: limited in time, its failure caught, its result made ready to store."""

import contextlib
import faulthandler
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import IO, Any

from midnet_bench import compiled
from midnet_bench.campaign.payload import encode_tables
from midnet_bench.campaign.signals import SIGNALS_TO_END
from midnet_bench.campaign.trial import RunTrials, TrialResult, TrialSpec

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

HARD_LIMIT_S = 2.0
"""native code that goes on this long after the time limit is ended together with its process"""


@dataclass(frozen=True)
class Outcome:
    """What a worker hands back; exactly one of ``payload`` and ``failure`` is there."""

    trial_id: str
    wall_s: float
    simulated_s: float | None = None
    payload: bytes | None = None
    failure: str | None = None


class TrialTimeout(BaseException):
    """The trial's wall time is over. Not an Exception, so that no handler in a trial can swallow it."""


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


def attempt_together(
    run_trials: RunTrials, specs: Sequence[TrialSpec], limit_s: float, marks: Path | None
) -> list[Outcome]:
    """The outcomes of trials that share a simulation; no exception leaves it but Ctrl-C's.

    Each gets an equal part of the wall time. Where they cannot be run together, or not within the time limit
    of one trial, each is run alone.

    While they run, a file named by the first and by the process stands in ``marks``, so that the parent knows
    what a worker does, or did when it died. A trial over its limit is interrupted; if it sits in native code
    that cannot be interrupted, its process ends and the mark keeps the stack.
    """
    start_s = time.perf_counter()
    results: list[tuple[float, bytes] | str] = []
    with _mark(marks, specs[0].trial_id) as stack_file:
        try:
            with _time_limit(limit_s, stack_file):
                _use_one_thread()
                results = [_packed(result) for result in run_trials(specs)]
        except KeyboardInterrupt:  # workers never hear it: this is the campaign's own process
            raise
        except BaseException as error:
            faulthandler.cancel_dump_traceback_later()
            if len(specs) == 1:
                failure = traceback.format_exc().strip()
                if isinstance(error, TrialTimeout):
                    failure += f": still running after its limit of {limit_s:g} s of wall time"
                results = [failure]
    if not results:
        return [attempt(run_trials, spec, limit_s, marks) for spec in specs]
    wall_s = (time.perf_counter() - start_s) / len(specs)
    return [
        Outcome(spec.trial_id, wall_s, failure=packed)
        if isinstance(packed, str)
        else Outcome(spec.trial_id, wall_s, *packed)
        for spec, packed in zip(specs, results, strict=True)
    ]


def attempt(run_trials: RunTrials, spec: TrialSpec, limit_s: float, marks: Path | None) -> Outcome:
    """The outcome of one trial; see :func:`attempt_together`."""
    return attempt_together(run_trials, [spec], limit_s, marks)[0]


def _packed(result: TrialResult | Exception) -> tuple[float, bytes] | str:
    """A trial's simulated time and its tables ready to store; or why it failed."""
    try:
        if isinstance(result, Exception):
            raise result
        return float(result.simulated_s), encode_tables(result)
    except Exception:
        return traceback.format_exc().strip()


def marked(marks: Path) -> dict[str, str]:
    """The trials that were running when their workers ended -> the stack at that moment, if there is one."""
    if not marks.is_dir():  # somebody has deleted the folder
        return {}
    return {path.stem: path.read_text(errors="replace") for path in sorted(marks.iterdir())}


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
                lock(stack_file, wait=True)  # the parent that has it kills this process
            mark.unlink(missing_ok=True)  # it may be gone with its folder


def lock(file: IO[Any], wait: bool) -> None:
    """Lock a file until it is closed. Raises OSError if another process has it and ``wait`` is off."""
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextlib.contextmanager
def _time_limit(limit_s: float, stack_file: IO[str]) -> Iterator[None]:
    """Raises TrialTimeout when ``limit_s`` is over; two seconds later, ends the process by force.

    Python delivers signals to the main thread alone: in others, as on a Dask worker, force is all there is.
    """

    def interrupt(signum: int, frame: FrameType | None) -> None:
        raise TrialTimeout

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
