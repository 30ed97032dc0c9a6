"""Runs the trials that a campaign's store lacks, or plans them; loses nothing when it is stopped."""

import contextlib
import hashlib
import itertools
import math
import signal
import time
from collections import Counter
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from pathlib import Path

import joblib

from midnet_bench.campaign import store as stores
from midnet_bench.campaign.definition import ResolvedCampaign
from midnet_bench.campaign.pool import Group, LocalPool, Pool, interruptible, uninterrupted
from midnet_bench.campaign.provenance import Provenance, collect, remember, versions_note
from midnet_bench.campaign.store import Inventory, Store
from midnet_bench.campaign.trial import Cell, Outcome, TrialSpec
from midnet_bench.errors import InputError, MidnetBenchError, nearest_name

BACKENDS = ("loky", "dask")
RULE_OF_THUMB_BYTES = 20_000.0
FEW_TRIALS = 10
"""for a worker, each with those that share its simulation: no more are begun by their length alone"""
MOST_TOGETHER = 100  # trials of one simulation, which has all their tables in memory


class Interrupted(MidnetBenchError):
    """Ctrl-C, or a scheduler's SIGTERM. What was finished is stored."""

    def __init__(self, message: str, signal_number: int = signal.SIGINT) -> None:
        super().__init__(message)
        self.exit_code = 128 + signal_number


class Progress:
    """What the runner calls while a campaign runs; this one keeps silent."""

    def begin(self, total: int, done: int) -> None:
        """``total`` trials in the campaign, ``done`` of them by earlier runs."""

    def advance(self, outcome: Outcome) -> None:
        """One more trial is stored."""

    def note(self, text: str) -> None:
        """Something that the user should know, in one line."""

    def end(self) -> None:
        """Nothing more will come."""


@dataclass(frozen=True)
class CampaignOutcome:
    """How a campaign stands when its run has ended."""

    store: Path
    finished: int
    failed: int
    unusable: dict[str, int]
    """why trials that failed could not use their input -> how many; trying again would not help them"""
    ran: int  # trials that this run added
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
    wall_s: float  # estimate for what is left, with all the workers busy
    disk_bytes: float  # estimate for what is left
    measured_on: int  # finished trials that the estimates stand on; 0: a rule of thumb


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
    _check_options(backend, jobs, scheduler)
    definition = campaign.definition
    finished = failed = measured_on = 0
    wall_s = math.fsum(each.expected_wall_s for each in campaign.checked) / len(campaign.cells)
    size = RULE_OF_THUMB_BYTES
    path = Path(directory) / stores.FILE_NAME
    if path.exists() and not fresh:
        with stores.open_store(path) as store:
            store.refuse_unless_extended_by(definition)
            # a store holds no trials but those of the campaign that it was made for; this one extends that
            finished, failed = store.inventory(campaign.numbered_cells).count()
            if finished:
                measured_on, wall_s, size = store.sizes()
    to_run = campaign.total - finished - (0 if retry_failed else failed)
    workers = min(jobs or joblib.cpu_count(), max(1, to_run))
    wall_s, size = to_run * wall_s / workers, to_run * size
    return Plan(definition.cells, campaign.total, finished, failed, to_run, wall_s, size, measured_on)


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
    """Runs the trials that ``directory``'s store lacks, as the public ``run_campaign`` describes it.

    ``campaign`` may extend what the store was made for by trials or grid values. ``prepare`` is called once
    before workers start, if there is a trial to run.
    """
    start_s = time.perf_counter()
    progress = progress or Progress()
    directory = Path(directory)
    path = directory / stores.FILE_NAME
    with (
        contextlib.closing(_pool(backend, jobs, scheduler, progress)) as pool,
        stores.only_writer(directory),
    ):
        if fresh and (aside := stores.back_up(path)):
            progress.note(f"the old store is kept as {aside}")
        with stores.open_or_create(path, campaign.definition_in(directory)) as store:
            remember(path, store.definition)
            store.write_cells(campaign.numbered_cells)
            inventory = store.inventory()
            if inventory.damaged:
                store.forget(inventory.damaged)
                first, *others = inventory.damaged.values()
                more = f" and {len(others)} more" if others else ""
                progress.note(f"{path}: damaged; what cannot be read is run again: {first}{more}")
            ran, missing = pending_trials(campaign, inventory, retry_failed, pool.workers)
            if ran:
                _add_trials(store, pool, campaign, ran, missing, progress, prepare)
            finished, failed = store.counts()
            no_input = f"{InputError.__module__}.{InputError.__qualname__}: "
            return CampaignOutcome(
                store=path,
                finished=finished,
                failed=failed,
                unusable=Counter(
                    line.removeprefix(no_input) for line in store.failures() if line.startswith(no_input)
                ),
                ran=ran,
                wall_s=time.perf_counter() - start_s,
                notes=versions_note(store.runs()),
            )


def _check_options(backend: str, jobs: int | None, scheduler: str | None) -> None:
    """Raises InputError unless the options that say where trials run go together."""
    if backend not in BACKENDS:
        raise InputError(f"--backend {backend}: unknown{nearest_name(backend, BACKENDS)}")
    if backend != "dask" and scheduler is not None:
        raise InputError(f"--scheduler {scheduler}: only with --backend dask")
    if jobs is not None and jobs < 1:
        raise InputError(f"--jobs {jobs}: give 1 or more")


def _pool(backend: str, jobs: int | None, scheduler: str | None, progress: Progress) -> Pool:
    """The pool that the options ask for; says what is wrong with them before anything is touched."""
    _check_options(backend, jobs, scheduler)
    workers = joblib.cpu_count() if jobs is None else jobs
    if backend == "loky":
        return LocalPool(workers, progress.note)
    from midnet_bench.campaign.dask_pool import DaskPool

    return DaskPool(scheduler, progress.note, workers)


def pending_trials(
    campaign: ResolvedCampaign, inventory: Inventory, retry_failed: bool, workers: int
) -> tuple[int, Iterator[Group]]:
    """How many trials are to run, and which, in groups; there may be millions.

    Seed by seed, as :meth:`ResolvedCampaign.trials`, and of each seed the trials that take longest first.
    Where there are few trials for each worker, those that take longest come first of all: a worker that
    begins one at the end would keep the others waiting. Trials of one seed that share a simulation come as
    one group, up to ``MOST_TOGETHER`` of them.
    """
    nothing: set[int] = set()
    count = campaign.total
    shared: dict[Hashable, list[tuple[float, Cell, set[int]]]] = {}
    for cell, parameters, sharing in sorted(
        zip(campaign.numbered_cells, campaign.checked, campaign.sharing, strict=True),
        key=lambda each: -each[1].effort,
    ):
        done = inventory.finished.get(cell.number, nothing)
        if not retry_failed:
            done = done | inventory.failed.get(cell.number, nothing)
        count -= sum(seed in campaign.seeds for seed in done)
        shared.setdefault(sharing.simulation_key, []).append((parameters.effort, cell, done))
    together = [
        cells[first : first + MOST_TOGETHER]
        for cells in shared.values()
        for first in range(0, len(cells), MOST_TOGETHER)
    ]

    def groups() -> Iterator[tuple[float, Group]]:
        for seed, cells in itertools.product(campaign.seeds, together):
            missing = [cell for _, cell, done in cells if seed not in done]
            if missing:
                yield cells[0][0], [TrialSpec(cell.experiment, cell.parameters, seed) for cell in missing]

    missing = groups()
    first = list(itertools.islice(missing, FEW_TRIALS * workers + 1))
    if len(first) <= FEW_TRIALS * workers:
        first.sort(key=lambda each: -each[0])
    return count, (group for _, group in itertools.chain(first, missing))


def _add_trials(
    store: Store,
    pool: Pool,
    campaign: ResolvedCampaign,
    count: int,
    missing: Iterator[Group],
    progress: Progress,
    prepare: Callable[[], None],
) -> None:
    """Runs the ``count`` missing trials and stores each as it ends. Raises Interrupted on Ctrl-C."""
    run_id = store.begin_run(_provenance(campaign))
    specs: dict[str, TrialSpec] = {}  # of trials that were handed to the workers and have no outcome

    def begun() -> Iterator[Group]:
        for group in missing:
            specs.update((spec.trial_id, spec) for spec in group)
            yield group

    try:
        with interruptible():
            prepare()
            progress.begin(campaign.total, campaign.total - count)
            limit_s = campaign.campaign.trial_timeout_s
            with contextlib.closing(pool.outcomes(campaign.run_trials, begun(), limit_s)) as outcomes:
                for outcome in outcomes:
                    with uninterrupted():
                        store.record(run_id, specs.pop(outcome.trial_id), outcome)
                    progress.advance(outcome)
    except KeyboardInterrupt as interrupt:
        store.refuse_if_gone()
        raise Interrupted(
            f"interrupted; {sum(store.counts())} of {campaign.total} trials are stored in {store.path}:"
            " run the same command again to continue",
            *interrupt.args,
        ) from None
    finally:
        progress.end()
    store.end_run(run_id)


def _provenance(campaign: ResolvedCampaign) -> Provenance:
    """Where this run's trials come from; the package's commit says nothing of an experiment in a file."""
    provenance = collect(campaign.definition.base_seed)
    if campaign.experiment_file is not None:
        content = campaign.experiment_file.read_bytes()
        provenance["experiment_sha256"] = hashlib.sha256(content).hexdigest()
    return provenance
