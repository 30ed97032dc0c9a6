"""What a campaign would do, for ``--dry-run``: nothing is run and no store is made."""

from dataclasses import dataclass
from pathlib import Path

import joblib

from midnet_bench.campaign.definition import definition_of
from midnet_bench.campaign.pools import check_options
from midnet_bench.campaign.spec import Campaign, Experiments
from midnet_bench.campaign.store import FILE_NAME, open_store
from midnet_bench.experiments import registry

RULE_OF_THUMB_WALL_S = 15.0
RULE_OF_THUMB_BYTES = 20_000.0


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
    campaign: Campaign,
    directory: Path,
    *,
    jobs: int | None = None,
    backend: str = "loky",
    scheduler: str | None = None,
    retry_failed: bool = False,
    fresh: bool = False,
    experiments: Experiments = registry,
) -> Plan:
    """What :func:`run_campaign` with the same arguments would run.

    Raises:
        InputError: as :func:`run_campaign`, of a wrong option or if the store in ``directory`` is no good
            for ``campaign``. Whether a scheduler answers is not asked.
    """
    check_options(backend, jobs, scheduler)
    definition = definition_of(campaign, experiments)
    statuses: dict[str, str] = {}
    measured_on, wall_s, size = 0, RULE_OF_THUMB_WALL_S, RULE_OF_THUMB_BYTES
    path = directory / FILE_NAME
    if path.exists() and not fresh:
        with open_store(path) as store:
            store.refuse_unless_extended_by(definition)
            damaged = set(store.damaged().values())
            statuses = {key: status for key, status in store.statuses().items() if key not in damaged}
            if "finished" in statuses.values():
                measured_on, wall_s, size = store.sizes()
    # a store holds no trials but those of the campaign that it was made for, and this one extends that
    stored = list(statuses.values())
    finished, failed = stored.count("finished"), stored.count("failed")
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
