"""Campaigns of the registered experiments, from Python, whose loops are compiled before workers start."""

import contextlib
import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from midnet_bench import compiled
from midnet_bench.campaign import runner
from midnet_bench.campaign.definition import Campaign, ResolvedCampaign, resolve
from midnet_bench.campaign.runner import CampaignOutcome, Progress
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.geometry import Pose2D, lengths
from midnet_bench.settings import Scalar

LOOPS = 70  # how many a first detection trial with ``bullet`` compiles; with ``fast`` half as many again
SHORT: dict[str, dict[str, Scalar]] = {
    "detection": {"frames": 10},
    "labyrinth": {"time_limit_s": 2.0},
    "mapping": {"time_limit_s": 5.0},
}
"""experiment -> what makes a trial short; it still goes through all that a long one compiles"""
DECIDING = ("engine", "localization", "odometry")  # parameters that decide which loops a trial needs
Show = Callable[[int, int], None]  # is shown how many loops are compiled, of about how many


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


def compile_ahead(campaign: ResolvedCampaign, show: Show = lambda done, total: None) -> None:
    """Compile what a campaign's workers need, in this process, unless that was done before.

    A short trial is run for each engine and each way of knowing the pose. What fails here is left to the
    trials, whose failures are stored.

    Args:
        campaign: one whose trials are about to run.
        show: called before the first loop is compiled and after each; never where all are there.
    """
    name = campaign.definition.experiment
    if name not in SHORT or compiled.folder() is None:
        return
    wanted = {tuple((key, cell[key]) for key in DECIDING if key in cell): cell for cell in campaign.cells}
    for chosen in wanted:
        key = "-".join([name, *(str(value).partition(":")[0].replace("/", "_") for _, value in chosen)])
        if compiled.is_compiled(key):
            continue
        with _counted(show), contextlib.suppress(Exception):
            _run_short(name, **dict(chosen))
            compiled.note_compiled(key)


def compile_kernels() -> None:
    """Run every compiled loop once; about a minute without a cache."""
    from midnet_bench.navigation.navigator import compile_kernels as compile_navigation

    compile_navigation()
    for engine in ("fast", "bullet") if find_spec("pybullet") else ("fast",):
        for name in ("detection", "labyrinth", "mapping"):
            _run_short(name, engine=engine)
            if name != "mapping":
                _run_short(name, engine=engine, robots=3, odometry="encoder", localization="ukf+map")
    _run_short("detection", engine="fast", arena="people")
    _map_a_drive()


def _run_short(name: str, **values: Scalar) -> None:
    """One short trial of an experiment of ours. Raises what the trial raises."""
    found = registry.experiment(name)
    found.run(found.model.parse({**SHORT[name], **values}, name), 1)


@contextlib.contextmanager
def _counted(show: Show) -> Iterator[None]:
    done = 0

    def count() -> None:
        nonlocal done
        done += 1
        show(done, LOOPS)

    before, compiled.after_compiling[:] = compiled.after_compiling[:], [count]
    try:
        yield
    finally:
        compiled.after_compiling[:] = before


def _map_a_drive() -> None:
    """Graph SLAM and GMapping over a few scans of a round room, with a slip of the wheels and a loop."""
    from midnet_bench.io.scan_logs import LoggedScan, ScanLog, half_circle
    from midnet_bench.mapping.log_mapping import map_scans

    geometry = half_circle(180)
    poses = [Pose2D(0.5 * k if k < 8 else 8.0 - 0.5 * k, 0.0, 0.0) for k in range(16)]
    wall = geometry.directions * (6.0, 4.0)
    ranges = [lengths(wall - (pose.x, pose.y)) for pose in poses]
    slip = Pose2D(0.3, 0.2, math.pi / 3.0)
    scans = [
        LoggedScan(float(k), slip.compose(pose) if k > 10 else pose, ranges[k])
        for k, pose in enumerate(poses)
    ]
    log = ScanLog(Path("warm-up"), geometry, scans)
    for particles in (None, 2):
        map_scans(log, particles)
