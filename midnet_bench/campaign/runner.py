"""Runs the trials that a campaign's store lacks, or plans them; loses nothing when it is stopped."""

import contextlib
import hashlib
import math
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import joblib

from midnet_bench.campaign import store as stores
from midnet_bench.campaign import trust
from midnet_bench.campaign.database import only_writer
from midnet_bench.campaign.definition import ResolvedCampaign
from midnet_bench.campaign.pending import PendingTrials, pending_trials
from midnet_bench.campaign.pools import LokyPool, Pool, WorkersLost, check_options
from midnet_bench.campaign.progress import Progress
from midnet_bench.campaign.provenance import Provenance, collect, versions_note
from midnet_bench.campaign.signals import interruptible
from midnet_bench.campaign.trial import RunTrials, TrialSpec
from midnet_bench.campaign.worker import HARD_LIMIT_S, Outcome
from midnet_bench.errors import InputError, MidnetBenchError

MAX_LOSSES_IN_VAIN = 3
"""workers that die one after another before any of them has begun a trial"""
RULE_OF_THUMB_BYTES = 20_000.0


class Interrupted(MidnetBenchError):
    """Ctrl-C, or a scheduler's SIGTERM. What was finished is stored."""

    def __init__(self, message: str, signal_number: int = signal.SIGINT) -> None:
        super().__init__(message)
        self.exit_code = 128 + signal_number


@dataclass(frozen=True)
class CampaignOutcome:
    """How a campaign stands when its run has ended."""

    store: Path
    finished: int
    failed: int
    unusable: dict[str, int]
    """why trials that failed could not use their input -> how many; trying again would not help them"""
    ran: int
    """trials that this run added"""
    wall_s: float
    notes: list[str]
    """what the reader of the numbers should know, e.g. that they come from two versions of the code"""


@dataclass(frozen=True)
class Plan:
    """The size of a campaign and of what is left of it."""

    cells: int
    trials: int
    finished: int
    failed: int
    to_run: int
    wall_s: float
    """estimate for what is left, with all the workers busy"""
    disk_bytes: float
    """estimate for what is left"""
    measured_on: int
    """finished trials that the estimates stand on; 0: a rule of thumb"""


def plan(
    campaign: ResolvedCampaign,
    directory: str | Path,
    *,
    jobs: int | None = None,
    backend: str = "loky",
    scheduler: str | None = None,
    retry_failed: bool = False,
    fresh: bool = False,
) -> Plan:
    """What :func:`run_campaign` with the same arguments would run; nothing is run and no store is made.

    Raises:
        InputError: as :func:`run_campaign`, of a wrong option or if the store in ``directory`` is no good
            for ``campaign``. Whether a scheduler answers is not asked.
    """
    check_options(backend, jobs, scheduler)
    definition = campaign.definition
    finished = failed = 0
    measured_on, size = 0, RULE_OF_THUMB_BYTES
    wall_s = math.fsum(one.expected_wall_s for one in campaign.checked) / len(campaign.cells)
    path = Path(directory) / stores.FILE_NAME
    if path.exists() and not fresh:
        with stores.open_store(path) as store:
            store.refuse_unless_extended_by(definition)
            # a store holds no trials but those of the campaign that it was made for; this one extends that
            finished, failed = store.inventory(campaign.numbered_cells).count()
            if finished:
                measured_on, wall_s, size = store.sizes()
    all_trials = definition.cells * definition.trials
    to_run = all_trials - finished - (0 if retry_failed else failed)
    workers = min(jobs or joblib.cpu_count(), max(1, to_run))
    return Plan(
        cells=definition.cells,
        trials=all_trials,
        finished=finished,
        failed=failed,
        to_run=to_run,
        wall_s=to_run * wall_s / workers,
        disk_bytes=to_run * size,
        measured_on=measured_on,
    )


def run_campaign(
    campaign: ResolvedCampaign,
    directory: str | Path,
    *,
    jobs: int | None = None,
    backend: str = "loky",
    scheduler: str | None = None,
    fresh: bool = False,
    retry_failed: bool = False,
    progress: Progress | None = None,
    prepare: Callable[[], None] = lambda: None,
) -> CampaignOutcome:
    """Runs the trials that ``directory``'s store lacks; the same call again continues.

    Args:
        campaign: what to run; it may extend what the store was made for by trials or grid values.
        directory: where the store is or will be.
        jobs: worker processes of this machine, all its cores unless given.
        backend: ``loky`` or ``dask``.
        scheduler: of Dask, such as ``tcp://127.0.0.1:8786``; a cluster of this machine unless given.
        fresh: starts over and keeps the old store aside.
        retry_failed: runs failed trials again.
        progress: receives each outcome.
        prepare: called once before workers start, if there is a trial to run.

    Raises:
        InputError: a wrong option, or a store that is damaged, foreign, in use or another campaign's.
        StoreFull: no room; the same call continues when there is some.
        Interrupted: Ctrl-C.
    """
    start_s = time.perf_counter()
    progress = progress or Progress()
    directory = Path(directory)
    path = directory / stores.FILE_NAME
    with _pool(backend, jobs, scheduler, directory, progress) as pool, only_writer(directory):
        if fresh and (aside := stores.back_up(path)):
            progress.note(f"the old store is kept as {aside}")
        with stores.open_or_create(path, campaign.definition_in(directory)) as store:
            trust.remember(path, store.definition)
            store.write_cells(campaign.numbered_cells)
            inventory = store.inventory()
            _forget_damaged(store, inventory.damaged, progress)
            missing = pending_trials(campaign, inventory, retry_failed, pool.workers)
            ran = len(missing)
            if missing:
                _add_trials(store, pool, campaign, missing, progress, prepare)
            finished, failed = store.counts()
            return CampaignOutcome(
                store=path,
                finished=finished,
                failed=failed,
                unusable=_unusable(store),
                ran=ran,
                wall_s=time.perf_counter() - start_s,
                notes=versions_note(store.runs()),
            )


def _add_trials(
    store: stores.Store,
    pool: Pool,
    campaign: ResolvedCampaign,
    missing: PendingTrials,
    progress: Progress,
    prepare: Callable[[], None],
) -> None:
    """Runs the missing trials and stores each as it ends. Raises Interrupted on Ctrl-C."""
    run_id = store.begin_run(_provenance(campaign))
    total = campaign.definition.cells * campaign.definition.trials

    def keep(spec: TrialSpec, outcome: Outcome) -> None:
        store.record(run_id, spec, outcome)
        progress.advance(outcome)

    try:
        with interruptible():
            prepare()
            progress.begin(total, total - len(missing))
            limit_s = campaign.campaign.trial_timeout_s
            _run(pool, campaign.run_trials, missing, limit_s, keep, progress.note)
    except KeyboardInterrupt as interrupt:
        store.refuse_if_gone()
        raise Interrupted(
            f"interrupted; {sum(store.counts())} of {total} trials are stored in {store.path}:"
            " run the same command again to continue",
            *interrupt.args,
        ) from None
    finally:
        progress.end()
    store.end_run(run_id)


def _forget_damaged(store: stores.Store, damaged: Mapping[int, str], progress: Progress) -> None:
    """Makes trials that cannot be read any more count as not done, and says so."""
    if damaged:
        store.forget(damaged)
        first, *others = damaged.values()
        more = f" and {len(others)} more" if others else ""
        progress.note(f"{store.path}: damaged; what cannot be read is run again: {first}{more}")


@contextlib.contextmanager
def _pool(
    backend: str, jobs: int | None, scheduler: str | None, directory: Path, progress: Progress
) -> Iterator[Pool]:
    """The pool that the options ask for; says what is wrong with them before anything is touched."""
    check_options(backend, jobs, scheduler)
    workers = joblib.cpu_count() if jobs is None else jobs
    if backend == "dask":
        from midnet_bench.campaign.dask_pool import DaskPool

        pool: Pool = DaskPool(scheduler, progress.note, workers)
    else:
        pool = LokyPool(workers, directory / ".running", progress.note)
    with contextlib.closing(pool):
        yield pool


def _run(
    pool: Pool,
    run_trials: RunTrials,
    missing: PendingTrials,
    limit_s: float,
    keep: Callable[[TrialSpec, Outcome], None],
    note: Callable[[str], None],
) -> None:
    """Hands every trial's outcome to ``keep``, whatever happens to the workers.

    A worker that dies does not tell which trial did it. So those that were running, and those that shared
    a simulation with them, are repeated one at a time, and the one with which a worker dies again has failed.
    """
    suspects = PendingTrials()
    losses_in_vain = 0
    while missing or suspects:
        alone = bool(suspects)
        batch = suspects if alone else missing
        try:
            outcomes = pool.outcomes(run_trials, iter(batch), limit_s, one_at_a_time=alone)
            with contextlib.closing(outcomes):
                for outcome in outcomes:
                    keep(batch.take(outcome.trial_id), outcome)
                    losses_in_vain = 0
            if batch:
                raise WorkersLost("the workers stopped", {})
        except WorkersLost as lost:
            in_flight = {trial_id: stack for trial_id, stack in lost.in_flight.items() if trial_id in batch}
            losses_in_vain = 0 if in_flight else losses_in_vain + 1
            if losses_in_vain == MAX_LOSSES_IN_VAIN:
                raise MidnetBenchError(f"workers die before they begin a trial: {lost}") from lost
            for trial_id, stack in in_flight.items():
                together = batch.group_of(trial_id)
                if len(together) > 1:
                    for spec in together:
                        suspects.add(batch.take(spec.trial_id))
                    continue
                spec = batch.take(trial_id)
                if stack.startswith("Timeout"):
                    failure = (
                        f"{stack}\nstill in native code {HARD_LIMIT_S:g} s after its limit of {limit_s:g} s"
                    )
                    keep(spec, Outcome(trial_id, limit_s + HARD_LIMIT_S, failure=failure))
                elif alone:
                    failure = (
                        f"{stack}\nits worker died twice: it crashed, or lacked memory or, on a cluster, time"
                    )
                    keep(spec, Outcome(trial_id, 0.0, failure=failure.strip()))
                else:
                    suspects.add(spec)
            if suspects and not alone:
                note(f"a worker died; what was running is repeated, one at a time ({len(suspects)})")


def _unusable(store: stores.Store) -> dict[str, int]:
    name = f"{InputError.__module__}.{InputError.__qualname__}: "
    return Counter(line.removeprefix(name) for line in store.failures() if line.startswith(name))


def _provenance(campaign: ResolvedCampaign) -> Provenance:
    """Where this run's trials come from; the package's commit says nothing of an experiment in a file."""
    provenance = collect(campaign.definition.base_seed)
    if campaign.experiment_file is not None:
        content = campaign.experiment_file.read_bytes()
        provenance["experiment_sha256"] = hashlib.sha256(content).hexdigest()
    return provenance
