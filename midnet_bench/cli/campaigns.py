"""The commands that run campaigns: ``detection``, ``labyrinth``, ``run``."""

from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from midnet_bench.cli import options
from midnet_bench.cli.app import app

if TYPE_CHECKING:
    from midnet_bench.campaign.definition import Campaign
    from midnet_bench.campaign.runner import CampaignOutcome
    from midnet_bench.campaign.trial import Scalar

MAX_REASONS = 5
"""different reasons that are told when trials fail; failures.csv has them all"""


@app.command(rich_help_panel="Campaigns")
def detection(
    robots: Annotated[str, typer.Option(help="Team sizes, separated by commas.")] = "1,5",
    frames: Annotated[int, typer.Option(help="MIDNet frames per trial, at 5 Hz.")] = 1999,
    seed: options.Seed = 1,
    seeds: Annotated[int, typer.Option(min=1, help="Trials per team size, one seed each.")] = 1,
    arena: Annotated[str, typer.Option(help="Packaged arena or YAML file.")] = "map1",
    map_file: options.Map = None,
    settings: options.Settings = None,
    output: options.Output = None,
    jobs: options.Jobs = None,
    dry_run: options.DryRun = False,
    fresh: options.Fresh = False,
    retry_failed: options.RetryFailed = False,
    as_json: options.Json = False,
) -> None:
    """Print the paper's detection table, from simulated scans."""
    parameters = {"arena": arena, "frames": frames, **_parsed(settings, map_file)}
    campaign = _campaign("detection", {"robots": _integers(robots, "--robots")}, seeds, seed, parameters)
    _run(campaign, output, jobs, dry_run, fresh, retry_failed, as_json)


@app.command(rich_help_panel="Campaigns")
def labyrinth(
    trials: Annotated[int, typer.Option(min=1, help="Trials per cell, one seed each.")] = 20,
    robots: Annotated[str, typer.Option(help="Team sizes, separated by commas.")] = "1,2,3,4,5",
    intruders: Annotated[str, typer.Option(help="Numbers of intruders, separated by commas.")] = "1,2,3,4,5",
    seed: options.Seed = 1,
    arena: Annotated[str, typer.Option(help="Packaged arena or YAML file.")] = "map2",
    map_file: options.Map = None,
    settings: options.Settings = None,
    output: options.Output = None,
    jobs: options.Jobs = None,
    backend: options.Backend = "loky",
    scheduler: options.Scheduler = None,
    dry_run: options.DryRun = False,
    fresh: options.Fresh = False,
    retry_failed: options.RetryFailed = False,
    as_json: options.Json = False,
) -> None:
    """Run the paper's labyrinth sweep; the same command again goes on where it stopped."""
    parameters = {"arena": arena, **_parsed(settings, map_file)}
    grid = {
        "intruders": _integers(intruders, "--intruders"),
        "robots": _integers(robots, "--robots"),
    }
    campaign = _campaign("labyrinth", grid, trials, seed, parameters)
    _run(campaign, output, jobs, dry_run, fresh, retry_failed, as_json, backend, scheduler)


@app.command(rich_help_panel="Campaigns")
def run(
    file: Annotated[Path, typer.Argument(help="A campaign file, such as campaigns/labyrinth.yaml.")],
    trials: Annotated[int | None, typer.Option(min=1, help="Trials per cell instead of the file's.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="First seed instead of the file's.")] = None,
    map_file: options.Map = None,
    settings: options.Settings = None,
    output: options.Output = None,
    jobs: options.Jobs = None,
    backend: options.Backend = "loky",
    scheduler: options.Scheduler = None,
    dry_run: options.DryRun = False,
    fresh: options.Fresh = False,
    retry_failed: options.RetryFailed = False,
    as_json: options.Json = False,
) -> None:
    """Run any campaign file; the same command again goes on where it stopped."""
    from midnet_bench.campaign.definition import load_campaign, override

    campaign = override(load_campaign(file), _parsed(settings, map_file), trials=trials, base_seed=seed)
    _run(campaign, output, jobs, dry_run, fresh, retry_failed, as_json, backend, scheduler)


def _campaign(
    experiment: str,
    grid: "dict[str, list[int]]",
    trials: int,
    seed: int,
    parameters: "dict[str, Scalar]",
) -> "Campaign":
    from midnet_bench.campaign.definition import parse_campaign

    fixed = {key: value for key, value in parameters.items() if key not in grid}
    narrowed = {key: [parameters[key]] if key in parameters else values for key, values in grid.items()}
    values = {"experiment": experiment, "name": experiment, "grid": narrowed, "parameters": fixed}
    return parse_campaign({**values, "trials": trials, "base_seed": seed}, "command line")


def _run(
    campaign: "Campaign",
    output: Path | None,
    jobs: int | None,
    dry_run: bool,
    fresh: bool,
    retry_failed: bool,
    as_json: bool,
    backend: str = "loky",
    scheduler: str | None = None,
) -> None:
    from midnet_bench.campaign.definition import resolve
    from midnet_bench.campaign.progress import progress_on
    from midnet_bench.campaign.runner import plan, run_campaign
    from midnet_bench.experiments import registry

    directory = output or options.RESULTS / campaign.name
    resolved = resolve(campaign, registry)
    if dry_run:
        ahead = plan(
            resolved,
            directory,
            jobs=jobs,
            backend=backend,
            scheduler=scheduler,
            retry_failed=retry_failed,
            fresh=fresh,
        )
        finished = _counted(ahead.measured_on, "finished trial")
        basis = finished if ahead.measured_on else "a rule of thumb"
        typer.echo(
            f"{_counted(ahead.cells, 'cell')}, {_counted(ahead.trials, 'trial')},"
            f" {ahead.to_run} of them to run; by {basis} about "
            f"{timedelta(seconds=round(ahead.wall_s))} and {ahead.disk_bytes / 1e6:.1f} MB in {directory}"
        )
        return
    outcome = run_campaign(
        resolved,
        directory,
        jobs=jobs,
        backend=backend,
        scheduler=scheduler,
        fresh=fresh,
        retry_failed=retry_failed,
        progress=progress_on(),
    )
    from midnet_bench.cli.reports import present

    present(directory, as_json)
    for note in outcome.notes:
        typer.echo(f"note: {note}", err=True)
    if outcome.failed:
        raise typer.Exit(_tell_of_failures(outcome, directory / "failures.csv"))


def _tell_of_failures(outcome: "CampaignOutcome", file: Path) -> int:
    """Says why trials failed; the exit code: 2 if nothing but their input was wrong."""
    from midnet_bench.errors import InputError

    for reason, count in list(outcome.unusable.items())[:MAX_REASONS]:
        typer.echo(f"error: {reason} ({_counted(count, 'trial')})", err=True)
    unusable = sum(outcome.unusable.values())
    if unusable:
        typer.echo(f"{_counted(unusable, 'trial')} could not use the input: see {file}", err=True)
    others = outcome.failed - unusable
    if others:
        typer.echo(f"{_counted(others, 'trial')} failed: see {file}; --retry-failed tries again", err=True)
    return 1 if others else InputError.exit_code


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _parsed(settings: list[str] | None, map_file: Path | None) -> "dict[str, Scalar]":
    from midnet_bench.campaign.definition import parse_settings

    return parse_settings(settings or [], map_file)


def _integers(text: str, option: str) -> list[int]:
    from midnet_bench.errors import InputError

    try:
        return [int(part) for part in text.split(",")]
    except ValueError as error:
        raise InputError(
            f"{option} {text}: expected whole numbers separated by commas, such as 1,5"
        ) from error
