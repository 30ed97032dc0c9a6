"""One trial inside a worker process: limited in time, its failure caught, its result made ready to store."""

import contextlib
import ctypes
import faulthandler
import json
import os
import re
import signal
import sys
import threading
import time
import traceback
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import NoneType
from typing import IO, cast

from midnet_bench.campaign.trial import Row, RunTrial, TrialResult, TrialSpec

_SCALAR = (bool, int, float, str, NoneType)
SIGNALS_TO_END = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""Ctrl-C; what schedulers send; a terminal that is closed. All processes of a campaign get them."""
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


TABLE_NAME = re.compile("[a-z][a-z0-9_]{0,63}")
"""what a trial's table may be called; it becomes the name of a file"""
OTHER_FILES = ("timing", "failures")
"""tables of the whole campaign, which no trial has"""
UNPACKED_BYTES = 8_000_000
UNPACKED_TIMES = 12
"""tables unpack to at most ``UNPACKED_BYTES`` and so many times their packed size; ours to 8 times"""


def encode_tables(result: TrialResult) -> bytes:
    """A result's tables as compressed JSON: equal results give equal bytes, columns keep their order.

    Raises:
        ValueError: :func:`decode_tables` would not take them.
    """
    tables = {name: result.tables[name] for name in sorted(result.tables)}
    _check_tables(tables)
    text = json.dumps(tables, separators=(",", ":")).encode()
    payload = zlib.compress(text, level=6)
    if len(text) > _most_unpacked(payload):
        raise ValueError(f"the tables of a trial take {len(text)} bytes, and say the same again and again")
    return payload


def decode_tables(payload: bytes) -> dict[str, list[Row]]:
    """The tables that :func:`encode_tables` packed.

    Raises:
        ValueError: ``payload`` is damaged, or somebody else made it. No table has a name with a path in it,
            and no more memory is taken than the tables of a trial need.
    """
    try:
        unpacking = zlib.decompressobj()
        text = unpacking.decompress(payload, _most_unpacked(payload))
        if not unpacking.eof or unpacking.unused_data:
            raise ValueError("the tables are cut off, or larger than a trial's")
        tables = json.loads(text)
    except (TypeError, RecursionError, zlib.error) as error:
        raise ValueError(str(error)) from error
    _check_tables(tables)
    return cast(dict[str, list[Row]], tables)


def _most_unpacked(payload: bytes) -> int:
    return UNPACKED_BYTES + UNPACKED_TIMES * len(payload)


def _check_tables(tables: object) -> None:
    """Raises ValueError unless these are tables by name, lists of rows of numbers, texts and None."""
    if not isinstance(tables, dict):
        raise ValueError("not tables by name")
    for name, rows in tables.items():
        if not isinstance(name, str) or not TABLE_NAME.fullmatch(name) or name in OTHER_FILES:
            raise ValueError(f"no table can be called {name!r}")
        if not isinstance(rows, list):
            raise ValueError(f"{name}: not a list of rows")
        for row in rows:
            if not isinstance(row, dict):
                raise ValueError(f"{name}: a row is not columns with values")
            for column, value in row.items():
                if not isinstance(value, _SCALAR):
                    raise ValueError(f"{name}: {column!r}: neither a number nor a text")


def prepare_worker(parent_pid: int) -> None:
    """Called once in a fresh worker: to end is the parent's business, and no worker outlives its parent."""
    for number in SIGNALS_TO_END:
        signal.signal(number, signal.SIG_IGN)

    def leave_with_parent() -> None:
        while os.getppid() == parent_pid:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=leave_with_parent, daemon=True).start()


def attempt(run_trial: RunTrial, spec: TrialSpec, limit_s: float, marks: Path | None) -> Outcome:
    """The outcome of one trial; no exception leaves it but Ctrl-C's.

    While the trial runs, a file named by it and by the process stands in ``marks``, so that the parent knows
    what a worker does, or did when it died. A trial over its limit is interrupted; if it sits in native code
    that cannot be interrupted, its process ends and the mark keeps the stack.
    """
    start_s = time.perf_counter()
    with _mark(marks, spec.trial_id) as stack_file:
        try:
            with _time_limit(limit_s, stack_file):
                _use_one_thread()
                result = run_trial(spec)
                payload = encode_tables(result)
        except KeyboardInterrupt:  # workers never hear it: this is the campaign's own process
            raise
        except BaseException as error:
            faulthandler.cancel_dump_traceback_later()
            failure = traceback.format_exc().strip()
            if isinstance(error, TrialTimeout):
                failure += f": still running after its limit of {limit_s:g} s of wall time"
            return Outcome(spec.trial_id, time.perf_counter() - start_s, failure=failure)
    return Outcome(spec.trial_id, time.perf_counter() - start_s, float(result.simulated_s), payload)


def marked(marks: Path) -> dict[str, str]:
    """The trials that were running when their workers ended -> the stack at that moment, if there is one."""
    return {path.stem: path.read_text(errors="replace") for path in sorted(marks.iterdir())}


@contextlib.contextmanager
def _mark(marks: Path | None, trial_id: str) -> Iterator[IO[str]]:
    mark = None if marks is None else marks / f"{trial_id}.{os.getpid()}"
    try:
        stack_file = None if mark is None else mark.open("w")
    except OSError:  # no room for a mark is no reason to lose the trial
        stack_file = None
    if mark is None or stack_file is None:
        yield sys.__stderr__ or sys.stderr
        return
    try:
        with stack_file:
            faulthandler.enable(stack_file)  # the stack of a crash stands in the mark as well
            yield stack_file
            faulthandler.enable()
    finally:
        mark.unlink(missing_ok=True)  # it may be gone with its folder


@contextlib.contextmanager
def _time_limit(limit_s: float, stack_file: IO[str]) -> Iterator[None]:
    """Raises TrialTimeout in this thread when ``limit_s`` is over; later, ends the process by force.

    The interruption is CPython's asynchronous exception and not SIGALRM, because a Dask worker runs its
    tasks outside the main thread, where signals do not arrive.
    """
    thread_id = ctypes.c_ulong(threading.get_ident())
    lock = threading.Lock()
    is_over = False

    def interrupt() -> None:
        with lock:
            if not is_over:
                ctypes.pythonapi.PyThreadState_SetAsyncExc(thread_id, ctypes.py_object(TrialTimeout))

    timer = threading.Timer(limit_s, interrupt)
    timer.daemon = True
    timer.start()
    faulthandler.dump_traceback_later(limit_s + HARD_LIMIT_S, exit=True, file=stack_file)
    try:
        yield
    finally:
        faulthandler.cancel_dump_traceback_later()
        with lock:
            is_over = True
        timer.cancel()
        time.sleep(0)  # an interruption that was already on its way arrives here, inside attempt's try


def _use_one_thread() -> None:
    """OpenCV's own pool would fight the other workers for the cores; loky sets what BLAS and numba obey."""
    os.environ["OPENCV_FOR_THREADS_NUM"] = "1"  # for a trial that has yet to import it
    if "cv2" in sys.modules:
        sys.modules["cv2"].setNumThreads(1)
