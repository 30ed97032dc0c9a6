"""Trials in child processes of this machine, by joblib: limited in time, failures caught, none lost."""

import atexit
import contextlib
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future
from types import FrameType
from typing import Any, Protocol, TypeVar

import cloudpickle
import joblib

from midnet_bench import compiled
from midnet_bench.campaign.trial import Outcome, RunTrials, TrialSpec
from midnet_bench.errors import MidnetBenchError

SIGNALS_TO_END = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
"""Ctrl-C; what schedulers send; a terminal that is closed. All processes of a campaign get them."""
STALLED_S = 10.0  # after the moment at which a child should have ended itself
STARTS_WITHIN_S = 120.0  # a child, from its process to its first trial
STARTS = 3  # children that end one after another before they are ready
LEAVES_WITHIN_S = 5.0  # a thread whose campaign is abandoned; a cluster that is lost may never answer
ONE_THREAD = dict.fromkeys(
    (
        *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"),
        *("VECLIB_MAXIMUM_THREADS", "NUMEXPR_NUM_THREADS", "NUMBA_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"),
    ),
    "1",
)
"""environment of a child: threads of libraries would fight the other children for the cores"""

T = TypeVar("T")
Group = Sequence[TrialSpec]  # trials of one seed that run together; a trial alone is one too
Item = list[Outcome] | str
"""outcomes, or a note for the user in one line"""


class Pool(Protocol):
    """A place where trials run."""

    @property
    def workers(self) -> int:
        """How many trials it runs at a time, as far as it knows."""

    def outcomes(
        self, run_trials: RunTrials, groups: Iterator[Group], limit_s: float
    ) -> Generator[Outcome, None, None]:
        """The outcomes of all trials in ``groups`` as they finish, in any order.

        No more of ``groups`` are read than the workers need. Closing the iterator abandons what is running.
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


def in_thread(work: Callable[[], T]) -> T:
    """What ``work`` returns or raises; it runs in a thread of its own.

    Python raises KeyboardInterrupt in the main thread alone: inside joblib or Dask it could leave a lock
    behind, get lost in a destructor, or come out as another error.
    """
    done: Future[T] = Future()

    def run() -> None:
        try:
            done.set_result(work())
        except BaseException as error:
            done.set_exception(error)

    with uninterrupted():
        threading.Thread(target=run, daemon=True).start()
    return done.result()


def from_thread(
    work: Callable[[], Iterable[Item]],
    items: "queue.SimpleQueue[Item | BaseException | None]",
    cancel: Callable[[], None],
    note: Callable[[str], None],
) -> Generator[Outcome, None, None]:
    """The outcomes that ``work`` gives in a thread of its own, by way of ``items``; ``note`` gets the notes.

    The thread is there for what :func:`in_thread` says. ``cancel`` makes ``work`` end early.
    """

    def talk() -> None:
        end: BaseException | None = None
        try:
            for item in work():
                items.put(item)
        except BaseException as error:
            end = error
        items.put(end)

    thread = threading.Thread(target=talk, daemon=True)
    try:
        with uninterrupted():
            thread.start()
        while (item := items.get()) is not None:
            if isinstance(item, BaseException):
                raise item
            if isinstance(item, str):
                note(item)
            else:
                yield from item
    finally:
        cancel()
        thread.join(LEAVES_WITHIN_S)


class Cancelled(Exception):
    """The campaign is abandoned."""


class ChildDied(Exception):
    """A child ended before it replied; the message is the stack that it left, if any."""


class Child:
    """A Python process that runs trials, one group after the other. Raises ChildDied if it does not start.

    It imports what this process can, and nothing from the working folder, whatever files there are called.
    Signals to end are this process's business: they are blocked in the child.
    """

    def __init__(self) -> None:
        path = [str(place) for place in sys.path]
        code = f"import sys; sys.path[:] = {path!r}; from midnet_bench.campaign.child import serve; serve()"
        with _signals_blocked():
            self.process = subprocess.Popen(
                [sys.executable, "-P", "-c", code],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=None if sys.__stderr__ else subprocess.DEVNULL,
                env={**os.environ, **ONE_THREAD},
            )
        self._has_replied = self._has_grown = self._has_stalled = self._is_killed = False
        try:
            self._reply_to(b"", STARTS_WITHIN_S)
        except BaseException:
            self.end()
            raise

    @property
    def is_fit(self) -> bool:
        """Whether it can run another trial."""
        is_alive = self._has_replied and not self._is_killed and self.process.poll() is None
        return is_alive and not self._has_grown

    def run(self, run_trials: bytes, specs: Group, limit_s: float) -> list[Outcome] | None:
        """The outcomes of a group, None if its trials cannot be run together. Raises ChildDied.

        ``run_trials`` is pickled.
        """
        request = pickle.dumps((run_trials, list(specs), limit_s))
        outcomes, self._has_grown = self._reply_to(request, limit_s + STALLED_S)
        return outcomes

    def _reply_to(self, request: bytes, within_s: float) -> Any:
        requests, replies = self.process.stdin, self.process.stdout
        assert requests is not None
        assert replies is not None
        self._has_replied = False  # one that ends has closed its pipes before it can be seen to have ended
        timer = threading.Timer(within_s, self._end_stalled)
        timer.daemon = True
        timer.start()
        try:
            with contextlib.suppress(BrokenPipeError):
                requests.write(request)
                requests.flush()
            if replies.peek(1)[:1] == pickle.PROTO:  # type: ignore[attr-defined]
                reply = pickle.load(replies)
                self._has_replied = True
                return reply
            stack = replies.read().decode(errors="replace").strip()
        except (EOFError, pickle.UnpicklingError):  # it died while it replied
            stack = ""
        finally:
            timer.cancel()
        raise ChildDied(
            "it had stalled: stopped, or waiting for a file system" if self._has_stalled else stack
        )

    def _end_stalled(self) -> None:
        self._has_stalled = True
        self.kill()

    def kill(self) -> None:
        """Ends the process, whatever it does; a call that waits for its reply raises ChildDied."""
        self._is_killed = True
        self.process.kill()

    def end(self) -> None:
        """Ends the process and closes its pipes."""
        self.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            assert pipe is not None
            with contextlib.suppress(BrokenPipeError):
                pipe.close()


_idle: list[Child] = []
"""children without a trial, for the next one of this process"""


@atexit.register
def _end_idle() -> None:
    while _idle:
        _idle.pop().end()


class Children:
    """One child process for each thread that runs trials, as long as it does."""

    def __init__(self, note: Callable[[str], None] = lambda text: None) -> None:
        self._note = note
        self._busy: set[Child] = set()
        self._is_cancelled = False

    def run(self, run_trials: bytes, specs: Group, limit_s: float) -> list[Outcome]:
        """The outcomes of trials that share a simulation; ``run_trials`` is pickled.

        Where they cannot be run together, or not within the limit, each is run alone. A child that dies costs
        its own trials and no other: those of a group are run again, each alone, and a trial alone is run a
        second time, for a child may have been killed, or lacked memory.

        Raises:
            Cancelled: :meth:`cancel` was called.
            MidnetBenchError: no child can be started.
        """
        start_s = time.perf_counter()
        for is_last in (False, True):
            try:
                with self._child() as child:
                    outcomes = child.run(run_trials, specs, limit_s)
            except ChildDied as death:
                stack = str(death)
                is_over_limit = stack.startswith("Timeout")  # faulthandler's word
                if not is_over_limit and not is_last:
                    self._note(f"a worker died; what it ran is repeated, one at a time ({len(specs)})")
            else:
                if outcomes is not None:
                    return outcomes
            if len(specs) > 1:
                return [outcome for spec in specs for outcome in self.run(run_trials, [spec], limit_s)]
            if is_over_limit:
                break
        what = (
            f"still running after its limit of {limit_s:g} s of wall time"
            if is_over_limit
            else "its worker died twice: it crashed, or lacked memory or, on a cluster, time"
        )
        wall_s = time.perf_counter() - start_s
        return [Outcome(specs[0].trial_id, wall_s, failure=f"{stack}\n{what}".strip())]

    @contextlib.contextmanager
    def _child(self) -> Iterator[Child]:
        if self._is_cancelled:
            raise Cancelled
        child = _ready_child()
        self._busy.add(child)
        try:
            if self._is_cancelled:  # while the child started
                raise Cancelled
            yield child
        except ChildDied:
            if self._is_cancelled:
                raise Cancelled from None
            raise
        finally:
            self._busy.remove(child)
            if child.is_fit:
                _idle.append(child)
            else:
                child.end()

    def cancel(self) -> None:
        """Ends the children that run a trial; :meth:`run` raises Cancelled in their threads."""
        self._is_cancelled = True
        for child in tuple(self._busy):
            child.kill()


def _ready_child() -> Child:
    """One that waits, or a new one. Raises MidnetBenchError if none starts."""
    with contextlib.suppress(IndexError):
        while True:
            if (child := _idle.pop()).is_fit:
                return child
            child.end()
    why = ""
    for _ in range(STARTS):
        try:
            return Child()
        except ChildDied as death:
            why = str(death) or "it ends before its first trial"
        except (OSError, RuntimeError) as error:  # the latter: no thread can be started
            why = getattr(error, "strerror", None) or str(error)
    raise MidnetBenchError(
        f"no worker process can be started: {why};"
        " workers need memory, open files and processes (ulimit -n, -u)"
    )


@contextlib.contextmanager
def _signals_blocked() -> Iterator[None]:
    """Signals to end reach neither this thread nor what it starts inside."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS_TO_END)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def run_in_child(run_trials: bytes, specs: Group, limit_s: float) -> list[Outcome]:
    """:meth:`Children.run` without a way to cancel it, as on a worker of a cluster."""
    return Children().run(run_trials, specs, limit_s)


class LocalPool:
    """joblib's threads, each with a child process of this machine."""

    def __init__(self, jobs: int, note: Callable[[str], None] = lambda text: None) -> None:
        self.workers = jobs
        self._note = note

    def outcomes(
        self, run_trials: RunTrials, groups: Iterator[Group], limit_s: float
    ) -> Generator[Outcome, None, None]:
        """See :meth:`Pool.outcomes`."""
        compiled.folder()  # before the children start, so that they share it
        pickled = cloudpickle.dumps(run_trials)
        items: queue.SimpleQueue[Item | BaseException | None] = queue.SimpleQueue()
        children = Children(items.put)

        def work() -> Iterator[Item]:
            with joblib.parallel_config(backend="threading"):
                if joblib.effective_n_jobs(self.workers) < self.workers:
                    yield "one trial runs at a time, since joblib cannot use /dev/shm"
                parallel = joblib.Parallel(self.workers, return_as="generator_unordered", batch_size=1)
                yield from parallel(joblib.delayed(children.run)(pickled, group, limit_s) for group in groups)

        return from_thread(work, items, children.cancel, self._note)

    def close(self) -> None:
        """Nothing to let go of: children without a trial wait for the next campaign of this process."""
