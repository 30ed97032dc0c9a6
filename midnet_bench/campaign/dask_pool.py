"""Trials on a Dask cluster. Needs the extra ``midnet-bench[dask]``."""

import asyncio
import contextlib
import itertools
import logging
import math
import queue
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from importlib import metadata
from typing import Any

import cloudpickle

from midnet_bench.campaign.pool import Group, Item, from_thread, in_thread, run_in_child
from midnet_bench.campaign.trial import Outcome, RunTrials
from midnet_bench.errors import InputError, MidnetBenchError

try:
    import distributed
except ImportError as error:
    raise InputError("--backend dask needs Dask's scheduler: pip install 'midnet-bench[dask]'") from error

CONNECT_TIMEOUT_S = 5
POLL_S = 0.5  # between two looks at the workers of the cluster
LOST = "the workers of the cluster that ran it ended, one after the other: they lacked memory or time"
TELL_AFTER_S = 2.0  # without any worker; one that died is started again in less
_LOGGERS = [
    logging.getLogger(name) for name in ("distributed.client", "distributed.batched", "tornado.application")
]
"""what they log comes up as the error in outcomes, or is of a connection that we close"""


class DaskPool:
    """The workers behind one Dask scheduler; they do best with one thread each (``--nthreads 1``).

    Workers may come and go; while there are none, trials wait.

    ``scheduler`` is an address such as ``tcp://127.0.0.1:8786``; None: a cluster of so many ``workers`` on
    this machine, which ends with the pool. ``note`` gets a line when trials begin to wait for a worker.

    Raises:
        InputError: no scheduler answers at the address, or the workers lack this version of midnet-bench.
    """

    def __init__(self, scheduler: str | None, note: Callable[[str], None], workers: int = 1) -> None:
        self._note = note
        self._absent_since_s: float | None = None
        self._held = contextlib.ExitStack()
        in_thread(lambda: self._connect(scheduler, workers))

    def _connect(self, scheduler: str | None, workers: int) -> None:
        with contextlib.ExitStack() as held:
            if scheduler is None:
                cluster: Any = distributed.LocalCluster(  # type: ignore[no-untyped-call]
                    n_workers=workers,
                    threads_per_worker=1,
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
                held.callback(cluster.close, timeout=CONNECT_TIMEOUT_S)
                scheduler = str(cluster.scheduler_address)
            self._name = f"--scheduler {scheduler}"
            try:
                # the client itself would wait without end for a server that listens and says nothing
                answers = asyncio.run(_identity(scheduler)).get("type")
            except (OSError, ValueError) as error:
                raise InputError(
                    f"{self._name}: no Dask scheduler answers there within {CONNECT_TIMEOUT_S} s"
                    " (expected an address such as tcp://127.0.0.1:8786)"
                ) from error
            if answers != "Scheduler":
                raise InputError(f"{self._name}: a Dask {answers} answers there, not a scheduler")
            for logger in _LOGGERS:
                held.callback(logger.setLevel, logger.level)
                logger.setLevel(logging.CRITICAL)
            self._client = distributed.Client(  # type: ignore[no-untyped-call]
                scheduler, timeout=CONNECT_TIMEOUT_S, set_as_default=False
            )
            held.callback(self._client.close, timeout=CONNECT_TIMEOUT_S)
            self._check_versions()
            self._held = held.pop_all()

    def _check_versions(self) -> None:
        """Raises InputError if a worker has another midnet-bench: it would fail in its first trial."""
        try:
            versions = set(self._client.run(metadata.version, "midnet-bench").values())
        except metadata.PackageNotFoundError:
            versions = {"none"}
        here = metadata.version("midnet-bench")
        if versions - {here}:
            raise InputError(
                f"{self._name}: its workers have midnet-bench {', '.join(sorted(versions))},"
                f" here it is {here}; install the same one there"
            )

    @property
    def workers(self) -> int:
        """See :class:`Pool`."""
        return in_thread(self._cores)

    def _cores(self) -> int:
        cores: Mapping[str, int] = self._client.ncores()  # type: ignore[no-untyped-call]
        return sum(cores.values())

    def outcomes(
        self, run_trials: RunTrials, groups: Iterator[Group], limit_s: float
    ) -> Generator[Outcome, None, None]:
        """See :meth:`Pool.outcomes`. Dask tries a group on several workers before it gives it up."""
        finished: queue.SimpleQueue[Any] = queue.SimpleQueue()
        return from_thread(
            lambda: self._talk(cloudpickle.dumps(run_trials), groups, limit_s, finished),
            queue.SimpleQueue(),
            lambda: finished.put(None),
            self._note,
        )

    def _talk(
        self, run_trials: bytes, groups: Iterator[Group], limit_s: float, finished: "queue.SimpleQueue[Any]"
    ) -> Iterator[Item]:
        """The outcomes of groups, and notes. ``finished`` gets futures that are done, and None to stop."""
        in_flight: dict[Any, Group] = {}
        try:
            if not self._cores():
                while not self._cores():
                    yield from self._absence()
                    with contextlib.suppress(queue.Empty):
                        finished.get(timeout=POLL_S)
                        return
                self._check_versions()
            while True:
                most = 2 * max(1, self._cores())
                for group in itertools.islice(groups, max(0, most - len(in_flight))):
                    future = self._client.submit(run_in_child, run_trials, group, limit_s, pure=False)
                    in_flight[future] = group
                    future.add_done_callback(finished.put)  # type: ignore[no-untyped-call]
                if not in_flight:
                    break
                try:
                    future = finished.get(timeout=POLL_S)
                except queue.Empty:
                    yield from self._absence()
                    continue
                if future is None:
                    return
                try:
                    outcomes = future.result(timeout=POLL_S)
                except TimeoutError:  # the worker that had the result has left: Dask runs it again
                    finished.put(future)
                    yield from self._absence()
                    continue
                except distributed.KilledWorker:  # not by a trial, which has a process of its own
                    group = in_flight.pop(future)
                    if len(group) > 1:
                        groups = itertools.chain([[spec] for spec in group], groups)
                    else:
                        yield [Outcome(group[0].trial_id, 0.0, failure=LOST)]
                    continue
                del in_flight[future]
                self._absent_since_s = None
                yield outcomes
        except MidnetBenchError:
            raise
        except Exception as error:
            raise MidnetBenchError(
                f"{self._name}: the cluster stopped working: {type(error).__name__}:"
                f" {' '.join(str(error).split())}; run the same command again to continue"
            ) from error
        finally:
            with contextlib.suppress(Exception):  # of a cluster that is lost
                self._client.cancel(list(in_flight))  # type: ignore[no-untyped-call]

    def _absence(self) -> Iterator[str]:
        """A note, once each time that the last worker has gone for some seconds."""
        if self._cores():
            self._absent_since_s = None
        elif self._absent_since_s is None:
            self._absent_since_s = time.monotonic()
        elif time.monotonic() - self._absent_since_s > TELL_AFTER_S:
            self._absent_since_s = math.inf
            yield (
                f"{self._name}: no workers there; the trials wait for one"
                " (Ctrl-C stops, and the same command continues)"
            )

    def close(self) -> None:
        """Leaves the cluster, which drops what it was still running for us."""
        in_thread(self._held.close)


async def _identity(address: str) -> dict[str, str]:
    async with asyncio.timeout(CONNECT_TIMEOUT_S):
        async with distributed.core.rpc(address) as server:  # type: ignore[no-untyped-call]
            identity: dict[str, str] = await server.identity()
            return identity
