"""What a child process does: it runs the trials that come through a pipe, one group after the other."""

import contextlib
import faulthandler
import functools
import os
import pickle
import queue
import sys
import threading
import time
import traceback
from collections.abc import Sequence
from typing import IO, Any

from midnet_bench import compiled
from midnet_bench.campaign.trial import Outcome, RunTrials, TrialResult, TrialSpec, encode_tables

MOST_GROWTH_BYTES = 300_000_000
"""in memory since the first trial; a child that has grown by more is replaced, for something in it hoards"""
IDLE_S = 300.0
"""after so long without a trial a child ends; the next campaign of its parent finds it before that"""


def attempt(run_trials: RunTrials, specs: Sequence[TrialSpec]) -> list[Outcome]:
    """The outcomes of trials of one seed, in this process; those that cannot be run together, one by one."""
    outcomes = attempt_together(run_trials, specs)
    return outcomes or [outcome for spec in specs for outcome in attempt(run_trials, [spec])]


def attempt_together(
    run_trials: RunTrials,
    specs: Sequence[TrialSpec],
    limit_s: float | None = None,
    stack_file: IO[bytes] | None = None,
) -> list[Outcome] | None:
    """The outcomes of trials that share a simulation; None if several cannot be run together.

    Each gets an equal part of the wall time. No exception leaves it but Ctrl-C's. What runs on after
    ``limit_s`` ends this process, and its stack is in ``stack_file``: Python or native code alike.
    """
    start_s = time.perf_counter()
    try:
        if limit_s is not None:
            faulthandler.dump_traceback_later(limit_s, exit=True, file=stack_file or sys.stderr)
        results = [_packed(result) for result in run_trials(specs)]
    except KeyboardInterrupt:  # a child never hears it: this is the campaign's own process
        raise
    except BaseException:
        if len(specs) > 1:
            return None
        results = [{"failure": traceback.format_exc().strip()}]
    finally:
        if limit_s is not None:
            faulthandler.cancel_dump_traceback_later()
    wall_s = (time.perf_counter() - start_s) / len(specs)
    return [Outcome(spec.trial_id, wall_s, **packed) for spec, packed in zip(specs, results, strict=True)]


def _packed(result: TrialResult | Exception) -> dict[str, Any]:
    """The fields of an outcome: simulated time and tables ready to store, or the failure."""
    try:
        if isinstance(result, Exception):
            raise result
        return {"simulated_s": float(result.simulated_s), "payload": encode_tables(result)}
    except Exception:
        return {"failure": traceback.format_exc().strip()}


def serve() -> None:
    """Runs the trials that come through standard input until that is closed, as it is when the parent ends.

    The first reply, None, says that the child is ready. Each later one is what came of a group, None if its
    trials cannot be run together, and whether the parent should take another child for the next; a limit or a
    crash leaves the stack in its place.
    """
    requests, replies = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)  # what a trial prints
    sys.stdout = sys.stderr
    if hasattr(os, "register_at_fork"):  # not on Windows
        os.register_at_fork(after_in_child=replies.raw.close)  # the parent waits for the pipe's end
    faulthandler.enable(replies)
    compiled.collect_garbage_rarely()
    received: queue.SimpleQueue[tuple[bytes, list[TrialSpec], float]] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(requests, received), daemon=True).start()
    _send(None, replies)
    first_bytes = 0
    with contextlib.suppress(queue.Empty):
        while True:
            run_trials, specs, limit_s = received.get(timeout=IDLE_S)
            run = functools.partial(_run_pickled, run_trials)
            outcomes = attempt_together(run, specs, limit_s, replies)
            compiled.collect_garbage_of_trial()
            first_bytes = first_bytes or _resident_bytes()
            _send((outcomes, _resident_bytes() - first_bytes > MOST_GROWTH_BYTES), replies)
    os._exit(0)


def _run_pickled(run_trials: bytes, specs: Sequence[TrialSpec]) -> Sequence[TrialResult | Exception]:
    """Unpickled where the trials run: if that fails, it is why they failed."""
    function: RunTrials = pickle.loads(run_trials)
    return function(specs)


def _receive(requests: IO[bytes], received: "queue.SimpleQueue[Any]") -> None:
    """Passes requests on, and ends the process when there can be no more, also in the middle of a trial."""
    try:
        while True:
            received.put(pickle.load(requests))
    finally:  # the pipe has ended, perhaps inside a request
        os._exit(0)


def _send(reply: object, replies: IO[bytes]) -> None:
    try:
        pickle.dump(reply, replies)
        replies.flush()
    except BrokenPipeError:  # the parent has ended
        os._exit(0)


def _resident_bytes() -> int:
    """This process's memory; 0 on a system without /proc."""
    with contextlib.suppress(OSError), open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    return 0
