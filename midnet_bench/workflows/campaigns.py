"""Campaigns by file or by name, and their runs, whose loops are compiled before workers start.

The files of ``campaigns/`` come with the package.
"""

import contextlib
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import joblib

from midnet_bench import compiled
from midnet_bench.campaign import runner
from midnet_bench.campaign.definition import Campaign, ResolvedCampaign, resolve
from midnet_bench.campaign.definition import load_campaign as load
from midnet_bench.campaign.runner import CampaignOutcome, Progress
from midnet_bench.campaign.trial import RunTrials, TrialResult, TrialSpec
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments import registry
from midnet_bench.geometry import Command, Pose2D, lengths
from midnet_bench.io.files import shipped_folder
from midnet_bench.robots.turtlebot3 import BURGER
from midnet_bench.settings import Scalar

if TYPE_CHECKING:
    from midnet_bench.experiments.guarded.parameters import GuardParameters

RECORDED_TRIALS = 4  # a detection campaign of up to so many trials is recorded by default
LOOPS = 70  # how many a first detection trial with ``bullet`` compiles; with ``fast`` half as many again
SHORT: dict[str, dict[str, Scalar]] = {
    "detection": {"frames": 10},
    "labyrinth": {"time_limit_s": 2.0},
    "mapping": {"time_limit_s": 5.0},
}
"""experiment -> what makes a trial short; it still goes through all that a long one compiles"""
DECIDING = ("engine", "localization", "odometry")  # parameters that decide which loops a trial needs
Show = Callable[[int, int], None]  # is shown how many loops are compiled, of about how many


def packaged_campaigns() -> dict[str, Path]:
    """The campaign files that come with the package, by name, in alphabetical order."""
    found = {path.stem: path for path in shipped_folder("campaigns", "campaigns").glob("*.yaml")}
    return dict(sorted(found.items()))


def campaign_file(name_or_path: str | Path) -> Path:
    """The file that is meant: the one at this path, else the packaged campaign of this name.

    Raises:
        InputError: there is neither.
    """
    path, name, packaged = Path(name_or_path), str(name_or_path), packaged_campaigns()
    if path.is_file():
        return path
    if name in packaged:
        return packaged[name]
    what = f"neither a campaign file nor a packaged campaign{nearest_name(name, packaged)}"
    if path.stem in packaged:
        what = f"there is no such file; 'midnet-bench run {path.stem}' runs the packaged campaign"
    elif name and path.exists():
        what = "is no ordinary file; give a campaign's .yaml"
    elif path.suffix or path.name != name:
        what = "there is no such file; the path starts from the working folder"
    raise InputError(f"{name}: {what}")


def summary_of(path: Path) -> str:
    """What a campaign is for, in one line: the first sentence of its file's leading comment; else empty."""
    lines = takewhile(lambda line: line.startswith("#"), path.read_text(encoding="utf-8").splitlines())
    sentence, stop, _ = " ".join(line.removeprefix("#").strip() for line in lines).partition(". ")
    return sentence + stop.strip()


def load_campaign(name_or_path: str | Path) -> Campaign:
    """A campaign, every cell checked against its experiment.

    Args:
        name_or_path: a YAML file, or the name of a packaged campaign such as ``"labyrinth"``.

    Raises:
        InputError: in one line, naming the file and the key.
    """
    campaign = load(campaign_file(name_or_path))
    resolve(campaign, registry)
    return campaign


def recorded_if_small(campaign: ResolvedCampaign) -> ResolvedCampaign:
    """The campaign, with frames and causes of errors kept if it is a small one of the detection test.

    Parameters, trial ids and the store's definition are those of the campaign without recording, so that more
    trials can be added to it; its tables are the same, with ``recorded`` and ``errors`` added.

    Args:
        campaign: of up to ``RECORDED_TRIALS`` trials; a larger one, one that is recorded anyway, and one that
            cannot be recorded (a network between guards and MIDNet) is returned as it is.
    """
    definition = campaign.definition
    if definition.experiment != "detection" or definition.cells * definition.trials > RECORDED_TRIALS:
        return campaign
    if any(cast("GuardParameters", one).network.is_used for one in campaign.checked):
        return campaign
    return replace(campaign, run_trials=partial(_run_recorded, campaign.run_trials))


def _run_recorded(run_trials: RunTrials, specs: Sequence[TrialSpec]) -> Sequence[TrialResult | Exception]:
    return run_trials([replace(spec, parameters={**spec.parameters, "record": True}) for spec in specs])


def refuse_missing_engine(campaign: ResolvedCampaign, directory: str | Path, **options: Any) -> None:
    """Raises InputError if trials are left, a cell simulates by PyBullet, and that is not installed here."""
    if find_spec("pybullet") is not None or all(cell.get("engine") != "bullet" for cell in campaign.cells):
        return
    if runner.plan(campaign, directory, **options).to_run:
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
    refuse_missing_engine(campaign, directory, **deciding)
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
    folder = compiled.folder()
    if name not in SHORT or folder is None:
        return
    loops = compiled.digest_of_sources(compiled.with_loops())
    wanted = {tuple((key, cell[key]) for key in DECIDING if key in cell): cell for cell in campaign.cells}
    for chosen in wanted:
        key = "-".join([name, *(str(value).partition(":")[0].replace("/", "_") for _, value in chosen)])
        is_done = folder / f"{key}-{loops}.compiled"
        if is_done.exists():
            continue
        with _counted(show), contextlib.suppress(Exception):
            _run_short(name, **dict(chosen))
            is_done.touch()


def compile_kernels() -> None:
    """Run every compiled loop once, in two processes; a minute and a half without a cache."""
    from midnet_bench.navigation.navigator import compile_kernels as compile_navigation

    # what has few loops in common stands side by side; the trials at the end find most of theirs
    parts: list[Callable[[], None]] = [compile_navigation, _drive_a_team, _map_a_drive]
    slipping: dict[str, Scalar] = {"robots": 3, "odometry": "encoder", "localization": "ukf+map"}
    for engine in ("fast", "bullet") if find_spec("pybullet") else ("fast",):
        parts += [partial(_run_short, name, engine=engine) for name in ("mapping", "detection", "labyrinth")]
        parts += [partial(_run_short, name, engine=engine, **slipping) for name in ("detection", "labyrinth")]
    joblib.Parallel(n_jobs=2, backend="multiprocessing")(joblib.delayed(part)() for part in parts)


def _drive_a_team() -> None:
    """Let robots drive among people by the compiled engine."""
    from midnet_bench.arena.arena import load_arena
    from midnet_bench.arena.layout import place
    from midnet_bench.simulation.world import World
    from midnet_bench.simulation.world_settings import WorldSettings

    world = World(place(load_arena("people"), 1, 3), WorldSettings(engine="fast"), BURGER)
    world.drive(0, Command(0.2, 0.5))
    for _ in range(5):
        world.step()
    world.close()


def _run_short(name: str, **values: Scalar) -> None:
    """One short trial of an experiment of ours. Raises what the trial raises."""
    found = registry.experiment(name)
    found.trials.run(found.parameters.parse({**SHORT[name], **values}, name), 1)


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
