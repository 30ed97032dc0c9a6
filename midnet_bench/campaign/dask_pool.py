"""Trials on a Dask cluster, through joblib's Dask backend. Needs the extra ``midnet-bench[dask]``."""

import asyncio
import contextlib
import logging
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from importlib import metadata
from typing import Any

import joblib

from midnet_bench.campaign.pools import Group, WorkersLost, abandoning_quietly
from midnet_bench.campaign.trial import RunTrials
from midnet_bench.campaign.worker import Outcome, attempt_together
from midnet_bench.errors import InputError, MidnetBenchError

try:
    import distributed
except ImportError as error:
    raise InputError("--backend dask needs Dask's scheduler: pip install 'midnet-bench[dask]'") from error

# private to joblib, which pyproject.toml bounds for it
from joblib._dask import DaskDistributedBackend

CONNECT_TIMEOUT_S = 5
POLL_S = 0.5
"""how often the cluster is asked for its workers"""
TELL_AFTER_S = 2.0
"""without any worker; one that died is started again in less"""


class _Backend(DaskDistributedBackend):  # type: ignore[misc]
    """joblib's backend without three surprises.

    It calls back for results alone, so a task that Dask has given up would be waited for without end; when
    one task fails, joblib drops the results of others that were not asked for yet; and with a single core
    in the cluster joblib would run the trials in this very process.
    """

    def __init__(self, client: distributed.Client) -> None:
        # with a time-out, joblib would end the campaign when it finds no worker for so long
        super().__init__(client=client, wait_for_workers_timeout=0)
        self.arrived: list[Outcome] = []
        self.in_flight: dict[str, str] = {}
        """the first trial of each group that the cluster has; joblib may hold some more that it has drawn"""

    def submit(self, func: Any, callback: Callable[[object], None]) -> object:
        self.in_flight |= {group[0].trial_id: "" for _, (_, group, *_), _ in func.items}

        def keep(out: object) -> None:
            if isinstance(out, list):  # the results of a batch
                for outcomes in out:
                    self.in_flight.pop(outcomes[0].trial_id)
                    self.arrived += outcomes
            callback(out)

        future = super().submit(func, keep)
        future.add_done_callback(lambda done: callback(done.exception()) if done.exception() else None)
        return future

    def retrieve_result_callback(self, out: object) -> object:
        if isinstance(out, BaseException):
            raise out
        return super().retrieve_result_callback(out)

    def effective_n_jobs(self, n_jobs: int) -> int:
        return max(2, super().effective_n_jobs(n_jobs))


class DaskPool:
    """The workers behind one Dask scheduler; they do best with one thread each (``--nthreads 1``).

    Workers may come and go; while there are none, trials wait.

    Args:
        scheduler: its address, such as ``tcp://127.0.0.1:8786``.
        note: is told, in one line, when the trials begin to wait for a worker.

    Raises:
        InputError: no scheduler answers at the address, or the workers lack this version of midnet-bench.
    """

    def __init__(self, scheduler: str, note: Callable[[str], None]) -> None:
        self._scheduler = scheduler
        self._note = note
        self._logger = logging.getLogger("distributed.client")
        self._log_level = self._logger.level
        try:
            # the client itself would wait without end for a server that listens and says nothing
            answers = asyncio.run(_identity(scheduler)).get("type")
        except (OSError, ValueError) as error:
            raise InputError(
                f"--scheduler {scheduler}: no Dask scheduler answers there within {CONNECT_TIMEOUT_S} s"
                " (expected an address such as tcp://127.0.0.1:8786)"
            ) from error
        if answers != "Scheduler":
            raise InputError(f"--scheduler {scheduler}: a Dask {answers} answers there, not a scheduler")
        self._logger.setLevel(logging.CRITICAL)  # what it logs comes up as the error in outcomes
        self._client = distributed.Client(  # type: ignore[no-untyped-call]
            scheduler, timeout=CONNECT_TIMEOUT_S, set_as_default=False
        )
        try:
            self._check_versions()
        except BaseException:
            self.close()
            raise

    def _check_versions(self) -> None:
        """Raises InputError if a worker has another midnet-bench: it would fail in its first trial."""
        try:
            versions = set(self._client.run(metadata.version, "midnet-bench").values())
        except metadata.PackageNotFoundError:
            versions = {"none"}
        here = metadata.version("midnet-bench")
        if versions - {here}:
            raise InputError(
                f"--scheduler {self._scheduler}: its workers have midnet-bench {', '.join(sorted(versions))},"
                f" here it is {here}; install the same one there"
            )

    @property
    def workers(self) -> int:
        """See :class:`Pool`."""
        cores: Mapping[str, int] = self._client.ncores()  # type: ignore[no-untyped-call]
        return sum(cores.values())

    def outcomes(
        self, run_trials: RunTrials, groups: Iterator[Group], limit_s: float, one_at_a_time: bool
    ) -> Generator[Outcome, None, None]:
        """See :meth:`Pool.outcomes`. Dask itself tries a task on several workers before it gives it up."""
        backend = _Backend(self._client)
        handed_out: set[str] = set()
        tasks = (joblib.delayed(attempt_together)(run_trials, group, limit_s, None) for group in groups)
        try:
            with self._telling_when_there_are_no_workers():
                self._wait_for_a_worker()
                with joblib.parallel_config(backend=backend, n_jobs=-1):
                    parallel = joblib.Parallel(
                        pre_dispatch=1 if one_at_a_time else "2 * n_jobs",
                        batch_size=1,
                        return_as="generator_unordered",
                    )
                    for outcomes in abandoning_quietly(parallel(tasks)):
                        handed_out |= {outcome.trial_id for outcome in outcomes}
                        yield from outcomes
        except distributed.KilledWorker as error:
            for outcome in backend.arrived:
                if outcome.trial_id not in handed_out:  # finished before the worker died of another one
                    yield outcome
            raise WorkersLost(str(error), dict(backend.in_flight)) from error
        except MidnetBenchError:
            raise
        except Exception as error:
            raise MidnetBenchError(
                f"--scheduler {self._scheduler}: the cluster stopped working: {type(error).__name__}:"
                f" {' '.join(str(error).split())}; run the same command again to continue"
            ) from error

    def _has_workers(self) -> bool:
        return bool(self._client.ncores())  # type: ignore[no-untyped-call]

    def _wait_for_a_worker(self) -> None:
        """Returns when there is one. joblib keeps as many trials in flight as there are workers by then."""
        if not self._has_workers():
            while not self._has_workers():
                time.sleep(POLL_S)
            self._check_versions()

    @contextlib.contextmanager
    def _telling_when_there_are_no_workers(self) -> Iterator[None]:
        """Notes it once each time that the last worker has gone, for as long as this is open."""
        is_over = threading.Event()

        def watch() -> None:
            absent_since_s: float | None = None
            was_told = False
            with contextlib.suppress(Exception):  # of a cluster that is lost: the main thread meets it too
                while not is_over.wait(POLL_S):
                    if self._has_workers():
                        absent_since_s, was_told = None, False
                    elif absent_since_s is None:
                        absent_since_s = time.monotonic()
                    elif not was_told and time.monotonic() - absent_since_s > TELL_AFTER_S:
                        was_told = True
                        self._note(
                            f"--scheduler {self._scheduler}: no workers there; the trials wait for one"
                            " (Ctrl-C stops, and the same command continues)"
                        )

        thread = threading.Thread(target=watch, daemon=True)
        thread.start()
        try:
            yield
        finally:
            is_over.set()
            thread.join(CONNECT_TIMEOUT_S)

    def close(self) -> None:
        """Leaves the cluster, which drops what it was still running for us."""
        self._client.close(timeout=CONNECT_TIMEOUT_S)  # type: ignore[no-untyped-call]
        self._logger.setLevel(self._log_level)


async def _identity(address: str) -> dict[str, str]:
    async with asyncio.timeout(CONNECT_TIMEOUT_S):
        async with distributed.core.rpc(address) as server:  # type: ignore[no-untyped-call]
            identity: dict[str, str] = await server.identity()
            return identity
