"""Runs what a campaign's store is still missing, and loses nothing when it is stopped."""

import contextlib
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

import joblib

from midnet_bench.campaign import store as stores
from midnet_bench.campaign.database import only_writer
from midnet_bench.campaign.definition import definition_of
from midnet_bench.campaign.pools import LokyPool, Pool, WorkersLost, check_options
from midnet_bench.campaign.progress import Progress
from midnet_bench.campaign.provenance import collect
from midnet_bench.campaign.spec import Campaign, Experiments, trials
from midnet_bench.campaign.trial import TrialSpec
from midnet_bench.campaign.worker import HARD_LIMIT_S, Outcome
from midnet_bench.errors import InputError, MidnetBenchError
from midnet_bench.experiments import registry

MOST_LOSSES_IN_VAIN = 3


class Interrupted(MidnetBenchError):
    """Ctrl-C. What was finished is stored."""

    exit_code = 130


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


def run_campaign(
    campaign: Campaign,
    directory: Path,
    *,
    jobs: int | None = None,
    backend: str = "loky",
    scheduler: str | None = None,
    fresh: bool = False,
    retry_failed: bool = False,
    progress: Progress | None = None,
    experiments: Experiments = registry,
) -> CampaignOutcome:
    """Runs the trials that ``directory``'s store lacks; the same call again resumes.

    Args:
        campaign: what to run; it may extend what the store was made for by trials or grid values.
        directory: where the store is or will be.
        jobs: worker processes of this machine, all its cores unless given.
        backend: ``loky``, or ``dask`` with the address of its ``scheduler``.
        scheduler: such as ``tcp://127.0.0.1:8786``.
        fresh: starts over and keeps the old store aside.
        retry_failed: runs failed trials again.
        progress: is told how the campaign goes.
        experiments: which experiments there are.

    Raises:
        InputError: a wrong option, or a store that is damaged, foreign, in use or another campaign's.
        StoreFull: no room; resumes when there is some.
        Interrupted: Ctrl-C.
    """
    start_s = time.perf_counter()
    progress = progress or Progress()
    definition = definition_of(campaign, experiments)
    path = directory / stores.FILE_NAME
    with _pool(backend, jobs, scheduler, directory) as pool, only_writer(directory):
        if fresh and (aside := stores.keep_aside(path)):
            progress.note(f"the old store is kept as {aside}")
        with stores.open_or_create(path, definition) as store:
            _forget_damaged(store, progress)
            missing = _missing(campaign, experiments, store, retry_failed)
            ran = len(missing)
            if missing:
                _add_trials(store, pool, campaign, missing, experiments, progress)
            statuses = list(store.statuses().values())
            return CampaignOutcome(
                store=path,
                finished=statuses.count("finished"),
                failed=statuses.count("failed"),
                unusable=_unusable(store),
                ran=ran,
                wall_s=time.perf_counter() - start_s,
                notes=_notes(store),
            )


def _add_trials(
    store: stores.Store,
    pool: Pool,
    campaign: Campaign,
    missing: dict[str, TrialSpec],
    experiments: Experiments,
    progress: Progress,
) -> None:
    """Runs the missing trials and stores each as it ends. Raises Interrupted on Ctrl-C."""
    run_id = store.begin_run(collect(campaign.base_seed))
    total = store.definition.cells * store.definition.trials

    def keep(spec: TrialSpec, outcome: Outcome) -> None:
        store.record(run_id, spec, outcome)
        progress.advance(outcome)

    progress.begin(total, total - len(missing))
    try:
        with _interruptible():
            _run(pool, missing, experiments, campaign.trial_timeout_s, keep, progress.note)
    except KeyboardInterrupt:
        raise Interrupted(
            f"interrupted; {len(store.statuses())} of {total} trials are stored in {store.path}:"
            " the same command goes on with the rest"
        ) from None
    finally:
        progress.end()
    store.end_run(run_id)


def _forget_damaged(store: stores.Store, progress: Progress) -> None:
    """Makes trials that cannot be read any more count as not done, and says so."""
    damaged = store.damaged()
    if damaged:
        store.forget(damaged)
        first, *others = damaged.values()
        more = f" and {len(others)} more" if others else ""
        progress.note(f"{store.path}: damaged; what cannot be read is run again: trial {first}{more}")


def _missing(
    campaign: Campaign, experiments: Experiments, store: stores.Store, retry_failed: bool
) -> dict[str, TrialSpec]:
    statuses = store.statuses()
    kept = ("finished",) if retry_failed else ("finished", "failed")
    specs = ((spec.trial_id, spec) for spec in trials(campaign, experiments))
    return {trial_id: spec for trial_id, spec in specs if statuses.get(trial_id) not in kept}


@contextlib.contextmanager
def _pool(backend: str, jobs: int | None, scheduler: str | None, directory: Path) -> Iterator[Pool]:
    """The pool that the options ask for; says what is wrong with them before anything is touched."""
    check_options(backend, jobs, scheduler)
    if scheduler is not None:
        from midnet_bench.campaign.dask_pool import DaskPool

        pool: Pool = DaskPool(scheduler)
    else:
        pool = LokyPool(joblib.cpu_count() if jobs is None else jobs, directory / ".running")
    with contextlib.closing(pool):
        yield pool


def _run(
    pool: Pool,
    missing: dict[str, TrialSpec],
    experiments: Experiments,
    limit_s: float,
    keep: Callable[[TrialSpec, Outcome], None],
    note: Callable[[str], None],
) -> None:
    """Hands every trial's outcome to ``keep``, whatever happens to the workers.

    A worker that dies does not tell which trial did it. So those that were running are repeated one at
    a time, and the one with which a worker dies again has failed.
    """
    suspects: dict[str, TrialSpec] = {}
    losses_in_vain = 0
    while missing or suspects:
        alone = bool(suspects)
        batch = suspects if alone else missing
        try:
            outcomes = pool.outcomes(
                experiments.run_trial, list(batch.values()), limit_s, one_at_a_time=alone
            )
            with contextlib.closing(outcomes):
                for outcome in outcomes:
                    keep(batch.pop(outcome.trial_id), outcome)
                    losses_in_vain = 0
            if batch:
                raise WorkersLost("the workers stopped", {})
        except WorkersLost as lost:
            in_flight = {trial_id: stack for trial_id, stack in lost.in_flight.items() if trial_id in batch}
            losses_in_vain = 0 if in_flight else losses_in_vain + 1
            if losses_in_vain == MOST_LOSSES_IN_VAIN:
                raise MidnetBenchError(f"workers die before they begin a trial: {lost}") from lost
            for trial_id, stack in in_flight.items():
                spec = batch.pop(trial_id)
                if stack.startswith("Timeout"):
                    failure = (
                        f"{stack}\nstill in native code {HARD_LIMIT_S:g} s after its limit of {limit_s:g} s"
                    )
                    keep(spec, Outcome(trial_id, limit_s + HARD_LIMIT_S, failure=failure))
                elif alone:
                    failure = f"{stack}\nits worker died twice: it crashed, or was killed for want of memory"
                    keep(spec, Outcome(trial_id, 0.0, failure=failure.strip()))
                else:
                    suspects[trial_id] = spec
            if suspects and not alone:
                note(f"a worker died; what was running is repeated, one at a time ({len(suspects)})")


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """The first Ctrl-C raises KeyboardInterrupt, a second one ends the process at once."""

    def interrupt(signum: int, frame: FrameType | None) -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():  # Python delivers signals to no other
        yield
        return
    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _unusable(store: stores.Store) -> dict[str, int]:
    name = f"{InputError.__module__}.{InputError.__qualname__}: "
    return Counter(line.removeprefix(name) for line in store.failures() if line.startswith(name))


def _notes(store: stores.Store) -> list[str]:
    codes = [
        f"{run.get('midnet_bench', 'unknown')} {str(run.get('commit') or 'installed')[:12]}"
        for run in store.runs()
    ]
    different = list(dict.fromkeys(codes))
    if len(different) > 1:
        return [f"these trials were run by {len(different)} versions of the code: {', '.join(different)}"]
    return []
