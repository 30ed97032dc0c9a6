"""Campaigns of the registered experiments, from Python."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from midnet_bench.campaign import runner
from midnet_bench.campaign.definition import Campaign, ResolvedCampaign, resolve
from midnet_bench.campaign.runner import CampaignOutcome, Progress
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.experiments.warm_up import Show, compile_ahead


def refuse_missing_engine(campaign: ResolvedCampaign) -> None:
    """Raises InputError if a cell simulates by PyBullet and that is not installed on this machine."""
    if find_spec("pybullet") is not None:
        return
    usual = registry.parameters_model(campaign.campaign.experiment).defaults().get("engine")
    if any(cell.get("engine", usual) == "bullet" for cell in campaign.cells):
        raise InputError(
            "engine: 'bullet' needs PyBullet, which is not installed (its wheels end at Python 3.11); take"
            " 'fast': --engine fast, or engine=\"fast\" in Python"
        )


def run_campaign(
    campaign: Campaign,
    directory: str | Path,
    *,
    jobs: int | None = None,
    backend: str = "loky",
    scheduler: str | None = None,
    fresh: bool = False,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> CampaignOutcome:
    """Run the trials that the store in ``directory`` lacks; the same call again continues.

    Args:
        campaign: read from a file, or made in Python.
        directory: the folder for ``campaign.sqlite``, made if it is not there.
        jobs: worker processes of this machine, all its cores unless given.
        backend: ``loky`` or ``dask``.
        scheduler: of Dask, such as ``tcp://127.0.0.1:8786``; a cluster of this machine unless given.
        fresh: starts over and keeps the old store aside.
        retry_failed: runs failed trials again.
        progress: receives the state of the campaign; silent unless given.

    Returns:
        How many trials finished, failed and ran, and where the store is.

    Raises:
        InputError: the campaign, an option or the store is refused; the message says which and why.
        StoreFull: the disk is full; what was finished is stored.
        Interrupted: Ctrl-C; what was finished is stored.
    """
    return run_resolved(
        resolve(campaign, registry),
        directory,
        jobs=jobs,
        backend=backend,
        scheduler=scheduler,
        fresh=fresh,
        retry_failed=retry_failed,
        progress=progress,
    )


def run_resolved(
    campaign: ResolvedCampaign,
    directory: str | Path,
    compiling: Callable[[], AbstractContextManager[Show]] = lambda: nullcontext(lambda done, total: None),
    **options: Any,
) -> CampaignOutcome:
    """As ``runner.run_campaign``, whose ``options`` these are, for workers here after loops are compiled.

    ``compiling`` opens what is shown how many loops are compiled, of about how many.
    """
    if options["backend"] != "loky":  # Dask's workers may be other machines
        return runner.run_campaign(campaign, directory, **options)

    def prepare() -> None:
        with compiling() as show:
            compile_ahead(campaign, show)

    deciding = {name: options[name] for name in ("jobs", "fresh", "retry_failed")}
    if runner.plan(campaign, directory, **deciding).to_run:
        refuse_missing_engine(campaign)
    return runner.run_campaign(campaign, directory, **options, prepare=prepare)
